//! The motion of the last quarter of a second, for readings that come late.

/// Entries, and the time between two of them, ns.
const ENTRIES: usize = 16;
const EVERY_NS: u64 = 16_000_000;

/// Velocities, m/s, and height, m, at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    pub(super) t_ns: u64,
    pub(super) vx_m_s: f32,
    pub(super) vy_m_s: f32,
    pub(super) y_m: f32,
}

/// The last entries, in a ring.
#[derive(Clone, Debug, Default)]
pub(super) struct History {
    entries: [Motion; ENTRIES],
    /// Number of entries, and place of the newest.
    length: usize,
    newest: usize,
}

impl History {
    /// Adds the motion of a tick, if the last entry is old enough.
    #[inline]
    pub(super) fn push(&mut self, motion: Motion) {
        if motion.t_ns >= self.newest().t_ns.saturating_add(EVERY_NS) || self.length == 0 {
            self.add(motion);
        }
    }

    #[inline(never)]
    fn add(&mut self, motion: Motion) {
        self.newest = (self.newest + 1) % ENTRIES;
        self.length = (self.length + 1).min(ENTRIES);
        if let Some(entry) = self.entries.get_mut(self.newest) {
            *entry = motion;
        }
    }

    fn newest(&self) -> Motion {
        self.entries.get(self.newest).copied().unwrap_or_default()
    }

    /// Returns the motion `age_ns` before `now`; none where that is longer ago than the
    /// entries reach.
    pub(super) fn before(&self, now: Motion, age_ns: u32) -> Option<Motion> {
        if age_ns == 0 {
            return Some(now);
        }
        let wanted_ns = now.t_ns.checked_sub(age_ns.into())?;
        let mut later = now;
        for back in 0..self.length {
            let place = (self.newest + ENTRIES - back) % ENTRIES;
            let &entry = self.entries.get(place)?;
            if entry.t_ns <= wanted_ns {
                return Some(between(entry, later, wanted_ns));
            }
            later = entry;
        }
        None
    }

    /// Adds corrections to the velocities, m/s, of all entries.
    pub(super) fn shift(&mut self, [vx_m_s, vy_m_s]: [f32; 2]) {
        for entry in &mut self.entries {
            entry.vx_m_s += vx_m_s;
            entry.vy_m_s += vy_m_s;
        }
    }
}

/// Returns the motion at a time between two, by a straight line.
fn between(before: Motion, after: Motion, t_ns: u64) -> Motion {
    // At most a second each: 32 bits are enough, and need no software.
    let whole = after.t_ns.saturating_sub(before.t_ns) as u32 as f32;
    let passed = t_ns.saturating_sub(before.t_ns) as u32 as f32;
    let part = if whole > 0.0 { passed / whole } else { 0.0 };
    let at = |from: f32, to: f32| from + part * (to - from);
    Motion {
        t_ns,
        vx_m_s: at(before.vx_m_s, after.vx_m_s),
        vy_m_s: at(before.vy_m_s, after.vy_m_s),
        y_m: at(before.y_m, after.y_m),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u16) -> Motion {
        let t = f32::from(ms);
        Motion { t_ns: u64::from(ms) * 1_000_000, vx_m_s: t, vy_m_s: -t, y_m: 2.0 * t }
    }

    #[test]
    fn returns_the_motion_at_any_time_of_the_last_quarter_of_a_second() {
        let mut history = History::default();
        (0..1_000).for_each(|ms| history.push(at(ms)));
        for age_ms in [0_u16, 1, 5, 16, 100, 231] {
            let found = history.before(at(1_000), u32::from(age_ms) * 1_000_000).unwrap();
            let expected = at(1_000 - age_ms);
            assert_eq!(found.t_ns, expected.t_ns);
            assert!((found.vx_m_s - expected.vx_m_s).abs() < 1e-3, "{found:?}");
            assert!((found.y_m - expected.y_m).abs() < 1e-3, "{found:?}");
        }
        assert_eq!(history.before(at(1_000), 300_000_000), None, "too long ago");
        assert_eq!(history.before(at(1_000), u32::MAX), None, "before the start");
        history.shift([1.0, 2.0]);
        let found = history.before(at(1_000), 100_000_000).unwrap();
        assert!((found.vx_m_s - 901.0).abs() < 1e-3 && (found.vy_m_s + 898.0).abs() < 1e-3);
        assert_eq!(History::default().before(at(1_000), 1), None);
        assert_eq!(History::default().before(at(1_000), 0), Some(at(1_000)));
    }
}
