//! The controller on a Cortex-M, at the end of a serial line.
//!
//! Bytes come in by interrupt ([`line`]), the main loop ([`run`]) gives them
//! to the protocol's station, and between two bytes the processor sleeps. In
//! live mode the control tick is SysTick's ([`tick`]). What a board must
//! provide is in [`board`]; when the program breaks off, [`crash`] puts the leg
//! in its safe state and says so.
//!
//! All unsafe code is in the modules that allow it by name: [`board`]'s files,
//! [`ceiling`], [`crash`], [`stack`] and [`tick`].
#![no_std]

pub mod board;
pub mod ceiling;
pub mod crash;
pub mod line;
pub mod ring;
pub mod run;
pub mod shared;
pub mod stack;
pub mod tick;
