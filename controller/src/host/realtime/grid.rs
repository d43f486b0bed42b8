//! The instants of a loop's ticks, on the monotonic clock.

use super::super::card::Role;

const NS_PER_S: u128 = 1_000_000_000;

/// Instants `(n + phase) / rate` since the clock's zero, exact for any rate: an
/// instant is rounded down to a nanosecond, and never drifts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    rate_hz: u32,
    half: bool,
}

impl Grid {
    /// The grid on which `role` ticks: the leg on the whole tick, the
    /// controller half a tick later. A rate of 0 counts as 1.
    #[must_use]
    pub fn of(role: Role, rate_hz: u32) -> Self {
        Self { rate_hz: rate_hz.max(1), half: role == Role::Controller }
    }

    /// Ticks a second.
    #[must_use]
    pub fn rate_hz(self) -> u32 {
        self.rate_hz
    }

    /// The instant of a tick, ns since the clock's zero.
    #[must_use]
    pub fn at_ns(self, tick: u64) -> u64 {
        let halves = 2 * u128::from(tick) + u128::from(self.half);
        let ns = halves * NS_PER_S / (2 * u128::from(self.rate_hz));
        u64::try_from(ns).unwrap_or(u64::MAX)
    }

    /// The newest tick whose instant is not after `now_ns`; `None` before the first.
    #[must_use]
    pub fn newest(self, now_ns: u64) -> Option<u64> {
        // floor(halves * 1e9 / 2r) <= now  <=>  halves * 1e9 < 2r (now + 1).
        let halves = (2 * u128::from(self.rate_hz) * (u128::from(now_ns) + 1) - 1) / NS_PER_S;
        let tick = halves.checked_sub(u128::from(self.half))? / 2;
        u64::try_from(tick).ok()
    }

    /// The first tick after `now_ns`.
    #[must_use]
    pub fn next_after(self, now_ns: u64) -> u64 {
        self.newest(now_ns).map_or(0, |tick| tick + 1)
    }

    /// Length of a tick, ns, rounded down.
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
    fn a_thousand_hertz_is_on_the_millisecond_and_the_controller_half_of_one_later() {
        let (leg, controller) = (Grid::of(Role::Leg, 1000), Grid::of(Role::Controller, 1000));
        assert_eq!((leg.at_ns(0), leg.at_ns(7)), (0, 7_000_000));
        assert_eq!((controller.at_ns(0), controller.at_ns(7)), (500_000, 7_500_000));
        assert_eq!((leg.newest(6_999_999), leg.newest(7_000_000)), (Some(6), Some(7)));
        assert_eq!((controller.newest(499_999), controller.newest(500_000)), (None, Some(0)));
        assert_eq!((controller.next_after(0), controller.next_after(500_000)), (0, 1));
    }

    #[test]
    fn a_rate_that_does_not_divide_a_second_does_not_drift() {
        let grid = Grid::of(Role::Leg, 700);
        // A year of ticks later, a whole second is still a whole second.
        let second = 365 * 86_400;
        assert_eq!(grid.at_ns(700 * second), second * 1_000_000_000);
        assert_eq!(grid.at_ns(700 * second + 1), second * 1_000_000_000 + 1_428_571);
    }

    proptest! {
        #[test]
        fn instants_and_ticks_are_inverse(
            rate_hz in 1_u32..=20_000,
            tick in 0_u64..1 << 33,
            late_ns in 0_u64..2_000_000,
            is_leg in any::<bool>(),
        ) {
            let grid = Grid::of(if is_leg { Role::Leg } else { Role::Controller }, rate_hz);
            let at_ns = grid.at_ns(tick);
            prop_assert_eq!(grid.newest(at_ns), Some(tick));
            let before = at_ns.checked_sub(1).and_then(|ns| grid.newest(ns));
            prop_assert_eq!(before, tick.checked_sub(1));
            let newest = grid.newest(at_ns + late_ns).unwrap();
            prop_assert!(grid.at_ns(newest) <= at_ns + late_ns);
            prop_assert!(grid.at_ns(newest + 1) > at_ns + late_ns);
            prop_assert_eq!(grid.next_after(at_ns + late_ns), newest + 1);
            let step = grid.at_ns(tick + 1) - at_ns;
            prop_assert!(step == grid.tick_ns() || step == grid.tick_ns() + 1);
        }

        #[test]
        fn the_controller_is_half_a_tick_behind_the_leg(
            rate_hz in 1_u32..=20_000,
            tick in 0_u64..1 << 33,
        ) {
            let (leg, controller) =
                (Grid::of(Role::Leg, rate_hz), Grid::of(Role::Controller, rate_hz));
            let (before, at, after) =
                (leg.at_ns(tick), controller.at_ns(tick), leg.at_ns(tick + 1));
            prop_assert!((at - before).abs_diff(after - at) <= 1);
        }
    }
}
