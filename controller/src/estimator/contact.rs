//! Touchdown and lift-off from contact readings of which some are wrong.

/// Time for which the readings must speak against the phase before it changes, ns: where
/// the motion makes the change likely, and where it does not.
const LIKELY_NS: u32 = 4_000_000;
const UNLIKELY_NS: u32 = 10_000_000;

/// A change of the phase, and between which readings it took place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Edge {
    /// Whether the foot is on the ground after it.
    pub(crate) in_stance: bool,
    /// Time of the last reading before it, ns.
    pub(crate) after_ns: u64,
    /// Time of the first reading after it, ns.
    pub(crate) until_ns: u64,
}

/// The phase, and the readings that speak against it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactFilter {
    in_stance: bool,
    /// Readings against the phase after which it changes.
    likely_after: u16,
    unlikely_after: u16,
    /// Readings against the phase, less those for it since.
    against: u16,
    last_ns: u64,
    after_ns: u64,
    until_ns: u64,
}

/// Returns a time in ticks, rounded; at least one.
fn ticks(time_ns: u32, tick_ns: u64) -> u16 {
    // In 32 bits: a Cortex-M divides 64 in software.
    let tick_ns = tick_ns.clamp(1, u64::from(time_ns)) as u32;
    ((time_ns + tick_ns / 2) / tick_ns).min(u32::from(u16::MAX)) as u16
}

impl ContactFilter {
    /// Returns a filter in flight.
    pub(super) fn new(tick_ns: u64) -> Self {
        Self {
            in_stance: false,
            likely_after: ticks(LIKELY_NS, tick_ns),
            unlikely_after: ticks(UNLIKELY_NS, tick_ns),
            against: 0,
            last_ns: 0,
            after_ns: 0,
            until_ns: 0,
        }
    }

    pub(super) fn in_stance(&self) -> bool {
        self.in_stance
    }

    /// Returns the change of the phase that the last readings may be the beginning of.
    pub(super) fn suspected(&self) -> Option<Edge> {
        let Self { in_stance, after_ns, until_ns, .. } = *self;
        (self.against > 0).then_some(Edge { in_stance: !in_stance, after_ns, until_ns })
    }

    /// Takes a reading; returns the change of the phase that it proves. `is_likely` tells
    /// whether the motion makes a change likely.
    #[inline]
    pub(super) fn update(
        &mut self,
        t_ns: u64,
        is_loaded: bool,
        is_likely: impl FnOnce() -> bool,
    ) -> Option<Edge> {
        let last_ns = core::mem::replace(&mut self.last_ns, t_ns);
        if is_loaded == self.in_stance {
            self.against = self.against.saturating_sub(1);
            return None;
        }
        if self.against == 0 {
            (self.after_ns, self.until_ns) = (last_ns, t_ns);
        }
        self.against = self.against.saturating_add(1);
        if self.against < self.likely_after || (self.against < self.unlikely_after && !is_likely())
        {
            return None;
        }
        let edge = self.suspected();
        self.against = 0;
        self.in_stance = is_loaded;
        edge
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_NS: u64 = 1_000_000;

    /// Returns the tick of each change that these readings prove, one a tick.
    fn edges(readings: &str, is_likely: bool) -> std::vec::Vec<(u64, Edge)> {
        let mut filter = ContactFilter::new(TICK_NS);
        let readings = readings.bytes().map(|byte| byte == b'#').zip(0_u64..);
        readings
            .filter_map(|(is_loaded, tick)| {
                let edge = filter.update(tick * TICK_NS, is_loaded, || is_likely)?;
                Some((tick, edge))
            })
            .collect()
    }

    extern crate std;

    #[test]
    fn a_change_is_dated_between_the_readings_at_which_it_began() {
        let edges = edges("....########.......", true);
        let [(first, touchdown), (second, lift_off)] = edges[..] else { panic!("{edges:?}") };
        assert_eq!((first, second), (7, 15), "the fourth reading");
        let at = |tick: u64| tick * TICK_NS;
        let expected = Edge { in_stance: true, after_ns: at(3), until_ns: at(4) };
        assert_eq!(touchdown, expected);
        assert_eq!(lift_off, Edge { in_stance: false, after_ns: at(11), until_ns: at(12) });
    }

    #[test]
    fn single_wrong_readings_change_nothing() {
        assert_eq!(edges("..#...#..#.#.....#....###....", true), []);
        let edges = edges("..#######.####.####.##.###", true);
        assert_eq!(edges.len(), 1);
    }

    #[test]
    fn a_change_that_the_motion_makes_unlikely_takes_longer() {
        let edges = edges("....############......", false);
        assert_eq!(edges.len(), 1);
        assert_eq!((edges[0].0, edges[0].1.until_ns), (13, 4 * TICK_NS), "the tenth reading");
    }

    #[test]
    fn the_time_of_a_change_is_the_same_at_every_rate() {
        let counts = |rate_hz: u64| {
            let filter = ContactFilter::new(1_000_000_000 / rate_hz);
            [filter.likely_after, filter.unlikely_after]
        };
        assert_eq!(counts(50), [1, 1]);
        assert_eq!(counts(1_000), [4, 10]);
        assert_eq!(counts(4_000), [16, 40]);
        assert_eq!(counts(20_000), [80, 200]);
    }
}
