//! The firmware with a flaw: it crashes after some ticks, in the way that the
//! number of the session says. Shows that a crash ends as it should; never to
//! be flashed for anything else.
#![no_std]
#![no_main]
#![allow(unsafe_code, clippy::panic)]

use controller::serial::pilot::Pilot;
use core::hint::black_box;
use core::ptr::{read_volatile, with_exposed_provenance};
use cortex_m_rt::entry;

/// Ticks that go well.
const TICKS: u32 = 100;

#[entry]
fn main() -> ! {
    firmware::run::run(|pilot: &mut Pilot<'static>| {
        if pilot.counts().ticks < TICKS {
            return;
        }
        match pilot.session() {
            Some(1) => panic!("as told"),
            Some(2) => cortex_m::asm::udf(),
            // No memory there, on any board.
            Some(3) => drop(unsafe { read_volatile(with_exposed_provenance::<u32>(0x7000_0000)) }),
            Some(4) => drop(black_box(too_deep(1))),
            _ => {}
        }
    })
}

/// Uses up the stack.
#[allow(unconditional_recursion)]
#[inline(never)]
fn too_deep(depth: u32) -> u32 {
    let frame = black_box([depth; 64]);
    too_deep(depth + 1) + black_box(frame).iter().sum::<u32>()
}
