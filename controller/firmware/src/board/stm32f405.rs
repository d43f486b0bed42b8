//! The chip `STM32F405xG`: a Cortex-M4F at 168 MHz, with a crystal of 8 MHz, and the host
//! at USART1: PA9 sends, PA10 receives.
//!
//! Written from RM0090 (reference manual) and DS8626 (data sheet). Not tried on
//! silicon yet; see the README for what the emulator could show.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::NVIC;
use cortex_m::peripheral::scb::SystemHandler;
use stm32f4::stm32f405::{FLASH, Interrupt, Peripherals, RCC, USART1, interrupt};

use super::FlashError;
use super::{Board, FlashChip, core_peripherals, run_systick};
use crate::line;
use crate::node::{TICK_PRIORITY, UART_PRIORITY};

/// Bits a second. The usual USB adapters do it, and a sample and its command
/// take less than a millisecond.
const BAUD: u32 = 2_000_000;
/// The crystal, MHz; the PLL takes 1 MHz of it.
const HSE_MHZ: u8 = 8;
/// The oscillator inside, MHz: 1 % at room temperature.
const HSI_MHZ: u8 = 16;
/// The PLL makes 336 MHz of 1 MHz, and half of that is the core's clock.
const PLL_TIMES: u16 = 336;
const PLL_CORE_HZ: u32 = 168_000_000;
/// Wait states at that clock and 2.7 to 3.6 V (RM0090, "Relation between CPU clock frequency and Flash memory read time").
const WAIT_STATES: u8 = 5;

/// Reads of the flag of a clock before the wait ends: at least 0.1 s at 16 MHz; a
/// crystal starts in 2 ms.
const CLOCK_ATTEMPTS: u32 = 400_000;
/// Reads of the flag of the flash: at least 1 s at 168 MHz; an erase takes up to 0.5 s.
const FLASH_ATTEMPTS: u32 = 50_000_000;
/// Reads of the flag of the UART: some milliseconds; a byte takes 5 us.
const UART_ATTEMPTS: u32 = 1_000_000;

/// Flash: where it begins, and the size of its first four sectors.
const FLASH_START: usize = 0x0800_0000;
const SECTOR_LEN: usize = 16 * 1024;
/// What unlocks its control register: RM0090, "Unlocking the Flash control register".
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// The core's clock, as `power_up` has found it, Hz.
static CORE_HZ: AtomicU32 = AtomicU32::new(0);

/// The board.
pub(crate) struct Stm32f405;

/// Clocks of the core and of the bus with USART1, Hz.
struct Clocks {
    core_hz: u32,
    apb2_hz: u32,
}

/// Reads a flag until it is set; returns false when it is not after so many `attempts`.
fn comes(attempts: u32, flag: impl Fn() -> bool) -> bool {
    (0..attempts).any(|_| flag())
}

/// 168 MHz from the crystal, which the regulator bears as it is after reset; from the oscillator inside when there is none;
/// 16 MHz from that alone when the PLL does not lock either.
fn start_clocks(rcc: &RCC, flash: &FLASH) -> Clocks {
    rcc.cr().modify(|_, w| w.hseon().on());
    let has_crystal = comes(CLOCK_ATTEMPTS, || rcc.cr().read().hserdy().is_ready());
    if !has_crystal {
        rcc.cr().modify(|_, w| w.hseon().off());
    }
    rcc.pllcfgr().modify(|_, w| {
        // SAFETY: within 2 to 63, 50 to 432, 2 to 15 (RM0090, RCC_PLLCFGR); 48 MHz at Q.
        unsafe {
            w.pllm().bits(if has_crystal { HSE_MHZ } else { HSI_MHZ });
            w.plln().bits(PLL_TIMES);
            w.pllq().bits(7);
        }
        w.pllp().div2();
        if has_crystal { w.pllsrc().hse() } else { w.pllsrc().hsi() }
    });
    rcc.cr().modify(|_, w| w.pllon().on());
    let is_locked = comes(CLOCK_ATTEMPTS, || rcc.cr().read().pllrdy().is_ready());

    // Slower reads before the faster clock.
    // SAFETY: the field has a bit more than the wait states need.
    flash.acr().modify(|_, w| unsafe { w.latency().bits(WAIT_STATES) });
    let is_patient = flash.acr().read().latency().bits() == WAIT_STATES;
    if is_locked && is_patient {
        // 42 MHz at most for APB1, 84 for APB2.
        rcc.cfgr().modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2());
        rcc.cfgr().modify(|_, w| w.sw().pll());
        if comes(CLOCK_ATTEMPTS, || rcc.cfgr().read().sws().is_pll()) {
            use_caches(flash);
            return Clocks { core_hz: PLL_CORE_HZ, apb2_hz: PLL_CORE_HZ / 2 };
        }
        rcc.cfgr().modify(|_, w| w.sw().hsi().ppre1().div1().ppre2().div1());
    }
    rcc.cr().modify(|_, w| w.pllon().off());
    use_caches(flash);
    let core_hz = u32::from(HSI_MHZ) * 1_000_000;
    Clocks { core_hz, apb2_hz: core_hz }
}

/// Instruction and data cache, emptied, and prefetch.
fn use_caches(flash: &FLASH) {
    flash.acr().modify(|_, w| w.icen().disabled().dcen().disabled());
    flash.acr().modify(|_, w| w.icrst().set_bit().dcrst().set_bit());
    flash.acr().modify(|_, w| w.icrst().clear_bit().dcrst().clear_bit());
    flash.acr().modify(|_, w| w.icen().enabled().dcen().enabled().prften().enabled());
}

/// The baud rate register for a clock, and whether to sample each bit 8 times
/// in place of 16: only that does an eighth of the clock.
const fn baud_register(clock_hz: u32) -> (u16, bool) {
    let cycles = (clock_hz + BAUD / 2) / BAUD;
    if cycles >= 16 {
        (cycles as u16, false)
    } else {
        (((cycles >> 3) << 4 | cycles & 7) as u16, true)
    }
}

// 2 MBd come out even with all three clocks.
const _: () = assert!(matches!(baud_register(84_000_000), (42, false)));
const _: () = assert!(matches!(baud_register(16_000_000), (0x10, true)));

fn usart() -> USART1 {
    // SAFETY: the main loop sets it up before its interrupt is on, then only the
    // interrupt uses it, and after a crash, interrupts off, the crash.
    unsafe { USART1::steal() }
}

impl Board for Stm32f405 {
    const NAME: &'static str = "stm32f405";

    fn power_up() {
        // SAFETY: once, before anything else uses them.
        let p = unsafe { Peripherals::steal() };
        let clocks = start_clocks(&p.RCC, &p.FLASH);
        CORE_HZ.store(clocks.core_hz, Ordering::Relaxed);

        p.RCC.ahb1enr().modify(|_, w| w.gpioaen().enabled());
        p.RCC.apb2enr().modify(|_, w| w.usart1en().enabled());
        // A peripheral wakes two cycles after its clock (errata sheet ES0182).
        let _ = p.RCC.apb2enr().read();

        // Level and function first, so that the pin never has another level. A
        // line that is not connected is pulled to its idle level.
        p.GPIOA.ospeedr().modify(|_, w| w.ospeedr9().high_speed());
        p.GPIOA.pupdr().modify(|_, w| w.pupdr9().pull_up().pupdr10().pull_up());
        p.GPIOA.afrh().modify(|_, w| w.afrh9().af7().afrh10().af7());
        p.GPIOA.moder().modify(|_, w| w.moder9().alternate().moder10().alternate());

        let (baud, eight_samples) = baud_register(clocks.apb2_hz);
        let usart = usart();
        // SAFETY: any value is a baud rate.
        usart.brr().write(|w| unsafe { w.bits(baud) });
        // 8 bits, no parity, 1 stop bit: all zeros.
        usart.cr1().write(|w| {
            w.over8().bit(eight_samples);
            w.te().enabled().re().enabled().rxneie().enabled().ue().enabled()
        });

        let mut core = core_peripherals();
        // SAFETY: the ceiling of the node is the tick's priority, and the UART
        // is above it; no lock relies on anything else.
        unsafe {
            core.SCB.set_priority(SystemHandler::SysTick, TICK_PRIORITY);
            core.NVIC.set_priority(Interrupt::USART1, UART_PRIORITY);
            NVIC::unmask(Interrupt::USART1);
        }
    }

    fn start_sending() {
        NVIC::pend(Interrupt::USART1);
    }

    #[inline(never)]
    fn send_polled(byte: u8) {
        let usart = usart();
        if comes(UART_ATTEMPTS, || usart.sr().read().txe().bit_is_set()) {
            usart.dr().write(|w| w.dr().set(u16::from(byte)));
        }
    }

    fn set_tick_rate(rate_hz: u32) {
        run_systick(CORE_HZ.load(Ordering::Relaxed), rate_hz);
    }

    fn end(_status: u8) -> ! {
        // The last byte goes out by itself; interrupts are off.
        loop {
            cortex_m::asm::wfi();
        }
    }
}

#[interrupt]
fn USART1() {
    let usart = usart();
    loop {
        let status = usart.sr().read();
        if status.ore().bit_is_set() {
            line::overrun();
        }
        // A byte with a framing error is passed on too: the checksum of its frame finds it.
        if status.rxne().bit_is_clear() && status.ore().bit_is_clear() {
            break;
        }
        // After the status, this clears both flags.
        line::received(usart.dr().read().dr().bits() as u8);
    }
    while usart.sr().read().txe().bit_is_set() {
        let Some(byte) = line::to_send() else {
            usart.cr1().modify(|_, w| w.txeie().disabled());
            return;
        };
        usart.dr().write(|w| w.dr().set(u16::from(byte)));
    }
    // There may be more: come back when there is room.
    usart.cr1().modify(|_, w| w.txeie().enabled());
}

/// Does something with the flash unlocked, and waits for its end. Option bytes,
/// and with them the write protection, are left alone: a protected sector is a
/// fault.
fn with_flash(act: impl FnOnce(&FLASH)) -> Result<(), FlashError> {
    // SAFETY: only the main loop uses it, through the slots, one call at a time.
    let flash = unsafe { FLASH::steal() };
    if !comes(FLASH_ATTEMPTS, || flash.sr().read().bsy().bit_is_clear()) {
        return Err(FlashError);
    }
    if flash.cr().read().lock().is_locked() {
        for key in KEYS {
            // SAFETY: the keys, in their order.
            flash.keyr().write(|w| unsafe { w.key().bits(key) });
        }
        if flash.cr().read().lock().is_locked() {
            return Err(FlashError);
        }
    }
    // What failed before is cleared by writing ones.
    flash.sr().write(|w| {
        w.eop().clear_bit_by_one().operr().clear_bit_by_one().wrperr().clear_bit_by_one();
        w.pgaerr().clear_bit_by_one().pgperr().clear_bit_by_one().pgserr().clear_bit_by_one()
    });
    act(&flash);
    let is_done = comes(FLASH_ATTEMPTS, || flash.sr().read().bsy().bit_is_clear());
    let status = flash.sr().read();
    flash.cr().write(|w| w.lock().set_bit());
    let is_wrong = status.operr().bit()
        || status.wrperr().bit()
        || status.pgaerr().bit()
        || status.pgperr().bit()
        || status.pgserr().bit();
    if is_done && !is_wrong { Ok(()) } else { Err(FlashError) }
}

impl FlashChip for Stm32f405 {
    /// All of the flash is one bank: code cannot be read meanwhile.
    const ERASE_STALLS: bool = true;

    unsafe fn erase(start: *mut u32, _words: usize) -> Result<(), FlashError> {
        let sector = start.addr().wrapping_sub(FLASH_START) / SECTOR_LEN;
        // Only the two sectors of the slots.
        if !(2..4).contains(&sector) {
            return Err(FlashError);
        }
        let result = with_flash(|flash| {
            // SAFETY: a sector that exists.
            flash
                .cr()
                .write(|w| unsafe { w.psize().psize32().ser().set_bit().snb().bits(sector as u8) });
            flash.cr().modify(|_, w| w.strt().set_bit());
        });
        // The caches hold what was there (RM0090, "Erase").
        // SAFETY: as in `with_flash`.
        use_caches(&unsafe { FLASH::steal() });
        result
    }

    unsafe fn program(place: *mut u32, word: u32) -> Result<(), FlashError> {
        with_flash(|flash| {
            // 32 bits at once, which 2.7 V and more allow.
            flash.cr().write(|w| w.psize().psize32().pg().set_bit());
            // SAFETY: a word of a slot that nothing borrows, as the caller
            // promises; the flash takes it as the word to program.
            unsafe { place.write_volatile(word) };
            cortex_m::asm::dsb();
        })
    }
}
