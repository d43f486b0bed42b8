#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod contents;
pub mod other;
pub mod read;
pub mod schema;
pub mod versions;
