//! The image that is flashed.
#![no_std]
#![no_main]

use cortex_m_rt::entry;

#[entry]
fn main() -> ! {
    firmware::run::run(|_| ())
}
