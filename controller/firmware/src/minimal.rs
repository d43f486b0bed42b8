//! The smallest firmware: a board, a tick, the control law; no serial protocol.
//!
//! It runs the shipped policy at 1 kHz on `mps2-an386`, where a simulated fall
//! stands in for sensors, and exits after two seconds. In your own firmware,
//! `measure` reads the sensors and `actuate` sets the actuators.
//!
//! ```console
//! $ cargo run --release --bin minimal --features minimal
//! ```
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{entry, exception};
use leg_control::command::LegCommand;
use leg_control::config::Config;
use leg_control::control::Controller;
use leg_control::measurement::{Contact, Measurement, Sensors};
use leg_control::policy::{Policy, SHIPPED};

const CORE_HZ: u32 = 25_000_000;
const RATE_HZ: u32 = 1_000;
const RUN_TICKS: u32 = 2_000;
const SET_POINT_M_S: f32 = 0.5;

/// Ticks of the timer since reset.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// The linker requires an interrupt table; this program enables no interrupt.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
#[allow(unsafe_code)]
static __INTERRUPTS: [extern "C" fn() -> !; 1] = [unexpected];

extern "C" fn unexpected() -> ! {
    semihosting::process::exit(102)
}

#[exception]
fn SysTick() {
    TICKS.store(TICKS.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
}

#[entry]
fn main() -> ! {
    let (Ok(policy), Ok(config), Some(core)) =
        (Policy::parse(SHIPPED), Config::at_rate(RATE_HZ), cortex_m::Peripherals::take())
    else {
        semihosting::process::exit(1)
    };
    let mut controller = Controller::new(policy, config);
    let mut timer = core.SYST;
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(CORE_HZ / RATE_HZ - 1);
    timer.enable_interrupt();
    timer.enable_counter();

    let mut done = 0;
    while done < RUN_TICKS {
        cortex_m::asm::wfi();
        while done < TICKS.load(Ordering::Relaxed) {
            let output = controller.step(Some(&measure(done)), SET_POINT_M_S);
            actuate(&output.command);
            done += 1;
        }
    }
    semihosting::process::exit(0)
}

/// Returns what the sensors measure at a tick: here a fall from 2 m, again and
/// again.
fn measure(tick: u32) -> Measurement {
    let t_s = (tick % 400) as f32 / RATE_HZ as f32;
    Measurement {
        t_ns: u64::from(tick) * 1_000_000,
        vx_m_s: 0.0,
        y_m: 2.0 - 4.9 * t_s * t_s,
        vy_m_s: -9.81 * t_s,
        contact: Contact::Sensed(false),
        density_ratio: None,
        sensors: Sensors::default(),
    }
}

/// Sets the actuators: here there are none.
fn actuate(command: &LegCommand) {
    core::hint::black_box(command);
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    semihosting::process::exit(101)
}
