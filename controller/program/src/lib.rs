//! What every program here does the same way: it stops in good order on a
//! signal, prints, reads policy files, and writes files whole or not at all.

pub mod output;
pub mod policy_file;
pub mod print;
pub mod stop;

pub use stop::Stop;
