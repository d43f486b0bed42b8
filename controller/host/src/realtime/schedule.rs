//! The instants of a loop's ticks on the monotonic clock.

use crate::link::Role;

const NS_PER_S: u128 = 1_000_000_000;

/// The instants `(n + phase) / rate` since the clock's zero, rounded down to a
/// nanosecond. They do not drift, for any rate.
///
/// The phase is a quarter of a period for the leg and three quarters for the
/// controller. Whole periods are avoided: the kernel's own timers expire there, and a
/// loop that shares an instant with them (at 1 kHz on a kernel of 250 Hz every fourth
/// tick) is 10 to 50 us late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickSchedule {
    rate_hz: u32,
    quarters: u8,
}

impl TickSchedule {
    /// Returns the schedule of `role`: the controller's is half a period after the
    /// leg's. A rate of 0 counts as 1.
    #[must_use]
    pub fn of(role: Role, rate_hz: u32) -> Self {
        let quarters = match role {
            Role::Leg => 1,
            Role::Controller => 3,
        };
        Self { rate_hz: rate_hz.max(1), quarters }
    }

    /// Returns the tick rate, Hz.
    #[must_use]
    pub fn rate_hz(self) -> u32 {
        self.rate_hz
    }

    /// Returns the instant of a tick, ns since the clock's zero.
    #[must_use]
    pub fn at_ns(self, tick: u64) -> u64 {
        let quarters = 4 * u128::from(tick) + u128::from(self.quarters);
        let ns = quarters * NS_PER_S / (4 * u128::from(self.rate_hz));
        u64::try_from(ns).unwrap_or(u64::MAX)
    }

    /// Returns the newest tick whose instant is not after `now_ns`; `None` before the
    /// first.
    #[must_use]
    pub fn newest(self, now_ns: u64) -> Option<u64> {
        // floor(quarters * 1e9 / 4r) <= now  <=>  quarters * 1e9 < 4r (now + 1).
        let quarters = (4 * u128::from(self.rate_hz) * (u128::from(now_ns) + 1) - 1) / NS_PER_S;
        let tick = quarters.checked_sub(u128::from(self.quarters))? / 4;
        u64::try_from(tick).ok()
    }

    /// Returns the first tick after `now_ns`.
    #[must_use]
    pub fn next_after(self, now_ns: u64) -> u64 {
        self.newest(now_ns).map_or(0, |tick| tick + 1)
    }

    /// Returns the period, ns, rounded down.
    #[must_use]
    pub fn tick_ns(self) -> u64 {
        1_000_000_000 / u64::from(self.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn at_1_khz_the_controller_ticks_half_a_millisecond_after_the_leg() {
        let (leg, controller) =
            (TickSchedule::of(Role::Leg, 1000), TickSchedule::of(Role::Controller, 1000));
        assert_eq!((leg.at_ns(0), leg.at_ns(7)), (250_000, 7_250_000));
        assert_eq!((controller.at_ns(0), controller.at_ns(7)), (750_000, 7_750_000));
        assert_eq!((leg.newest(7_249_999), leg.newest(7_250_000)), (Some(6), Some(7)));
        assert_eq!((controller.newest(749_999), controller.newest(750_000)), (None, Some(0)));
        assert_eq!((controller.next_after(0), controller.next_after(750_000)), (0, 1));
    }

    #[test]
    fn a_rate_that_does_not_divide_a_second_does_not_drift() {
        let schedule = TickSchedule::of(Role::Leg, 700);
        // A year of ticks later, a whole second is still exact.
        let second = 365 * 86_400;
        let quarter_ns = 357_142;
        assert_eq!(schedule.at_ns(700 * second), second * 1_000_000_000 + quarter_ns);
        assert_eq!(schedule.at_ns(700 * second + 1), second * 1_000_000_000 + 1_785_714);
    }

    proptest! {
        #[test]
        fn instants_and_tick_numbers_are_inverse(
            rate_hz in 1_u32..=20_000,
            tick in 0_u64..1 << 33,
            late_ns in 0_u64..2_000_000,
            is_leg in any::<bool>(),
        ) {
            let schedule = TickSchedule::of(if is_leg { Role::Leg } else { Role::Controller }, rate_hz);
            let at_ns = schedule.at_ns(tick);
            prop_assert_eq!(schedule.newest(at_ns), Some(tick));
            let before = at_ns.checked_sub(1).and_then(|ns| schedule.newest(ns));
            prop_assert_eq!(before, tick.checked_sub(1));
            let newest = schedule.newest(at_ns + late_ns).unwrap();
            prop_assert!(schedule.at_ns(newest) <= at_ns + late_ns);
            prop_assert!(schedule.at_ns(newest + 1) > at_ns + late_ns);
            prop_assert_eq!(schedule.next_after(at_ns + late_ns), newest + 1);
            let step = schedule.at_ns(tick + 1) - at_ns;
            prop_assert!(step == schedule.tick_ns() || step == schedule.tick_ns() + 1);
        }

        #[test]
        fn the_controller_ticks_half_a_period_after_the_leg(
            rate_hz in 1_u32..=20_000,
            tick in 0_u64..1 << 33,
        ) {
            let (leg, controller) =
                (TickSchedule::of(Role::Leg, rate_hz), TickSchedule::of(Role::Controller, rate_hz));
            let (before, at, after) =
                (leg.at_ns(tick), controller.at_ns(tick), leg.at_ns(tick + 1));
            prop_assert!((at - before).abs_diff(after - at) <= 1);
        }
    }
}
