//! Hops in the lanes of vectors, for the package `leg-lanes`; not part of the public interface.
//!
//! A lane holds one hop. All lanes integrate one segment of their stances at a time, by the code
//! that integrates a single stance; flights are computed lane by lane. A lane whose hop has ended
//! takes the next job at once.

use crate::apex::{Course, Next};
use crate::elongation::Elongation;
use crate::pair::Pair;
use crate::stance::{Setting, Stance, StanceEnd};
use crate::taylor::{Field, Jet, State};
use crate::{Action, Apex, Hop, Hopper};

pub use crate::real::{Mask, Real, rough_root};

/// Largest number of lanes.
pub const MAX_LANES: usize = 16;

/// A hop to compute.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The apex map.
    pub hopper: &'a Hopper,
    /// The first apex.
    pub start: Apex,
    /// The action at it.
    pub action: Action,
}

/// One number of each lane.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row([f64; MAX_LANES]);

/// The numbers of a stance and its setting, a row each: place and velocity, then these.
struct Rows([Row; 15]);

/// Row of the time since touchdown.
const TIME: usize = 4;
/// Row of the number of segments.
const SEGMENTS: usize = 5;
/// First row of the setting.
const SETTING: usize = 6;

impl Rows {
    /// Creates lanes without a hop: with a leg beyond its rest length, which needs no search.
    fn idle() -> Self {
        let setting = Setting {
            field: Field { spring_per_s2: 1.0, drag_per_m: Pair([0.0; 2]), net_gravity_m_s2: 1.0 },
            elongation: Elongation { rest_length_m: 1.0, max_m: 0.0, start_m: 0.0, rate_m_s: 0.0 },
            tolerance_m_s: 1.0,
        };
        let mut rows = Self([Row([0.0; MAX_LANES]); 15]);
        for lane in 0..MAX_LANES {
            rows.set(lane, &setting);
            rows.rest(lane);
        }
        rows
    }

    /// Lets a lane idle.
    fn rest(&mut self, lane: usize) {
        self.begin(lane, State { position_m: Pair([0.0, 1e3]), velocity_m_s: Pair([0.0, 1.0]) });
        self.0[SEGMENTS].0[lane] = 1.0;
    }

    /// Stores the setting of a lane.
    fn set(&mut self, lane: usize, setting: &Setting) {
        let Setting { field, elongation, tolerance_m_s } = *setting;
        let numbers = [
            field.spring_per_s2,
            field.drag_per_m[0],
            field.drag_per_m[1],
            field.net_gravity_m_s2,
            elongation.rest_length_m,
            elongation.max_m,
            elongation.start_m,
            elongation.rate_m_s,
            tolerance_m_s,
        ];
        for (row, number) in self.0[SETTING..].iter_mut().zip(numbers) {
            row.0[lane] = number;
        }
    }

    /// Begins a stance in a lane.
    fn begin(&mut self, lane: usize, touchdown: State) {
        let State { position_m: Pair([x, y]), velocity_m_s: Pair([vx, vy]) } = touchdown;
        for (row, number) in self.0.iter_mut().zip([x, y, vx, vy, 0.0, 0.0]) {
            row.0[lane] = number;
        }
    }

    fn state(&self, lane: usize) -> State {
        let [x, y, vx, vy] = [0, 1, 2, 3].map(|i| self.0[i].0[lane]);
        State { position_m: Pair([x, y]), velocity_m_s: Pair([vx, vy]) }
    }

    /// Integrates the next segment of every lane; returns the lanes as bits in which a stance
    /// ended, by an apex, a lift-off and a fall.
    #[inline(always)]
    fn advance<L: Real>(&mut self, jet: &mut Jet<L>, zero: L) -> [u32; 3] {
        macro_rules! of {
            ($i:expr) => {
                zero.load(&self.0[$i].0)
            };
        }
        let setting = Setting {
            field: Field {
                spring_per_s2: of!(SETTING),
                drag_per_m: Pair([of!(SETTING + 1), of!(SETTING + 2)]),
                net_gravity_m_s2: of!(SETTING + 3),
            },
            elongation: Elongation {
                rest_length_m: of!(SETTING + 4),
                max_m: of!(SETTING + 5),
                start_m: of!(SETTING + 6),
                rate_m_s: of!(SETTING + 7),
            },
            tolerance_m_s: of!(SETTING + 8),
        };
        let mut stance = Stance {
            state: State {
                position_m: Pair([of!(0), of!(1)]),
                velocity_m_s: Pair([of!(2), of!(3)]),
            },
            t_s: of!(TIME),
            segments: of!(SEGMENTS),
        };
        let (_, ended) = stance.advance(&setting, jet);
        let State { position_m: Pair([x, y]), velocity_m_s: Pair([vx, vy]) } = stance.state;
        let numbers = [x, y, vx, vy, stance.t_s, stance.segments];
        for (row, number) in self.0.iter_mut().zip(numbers) {
            number.store(&mut row.0);
        }
        [ended.corner.apex.bits(), ended.corner.lift_off.bits(), ended.fall.bits()]
    }
}

/// Computes the hop of each job in the lanes of `L`, of which `zero` is any value, and stores it
/// at the place of the job in `hops`.
#[inline(always)]
pub fn hop_all<L: Real>(zero: L, jobs: &[Job<'_>], hops: &mut [Hop]) {
    const { assert!(L::LANES <= MAX_LANES) };
    let mut queue = Queue { jobs, hops, begun: 0 };
    let mut rows = Rows::idle();
    let mut jet = Jet::new(zero);
    let mut lanes = [None; MAX_LANES];
    let mut busy = 0_u32;
    for (i, lane) in lanes.iter_mut().enumerate().take(L::LANES) {
        *lane = queue.refill(i, &mut rows);
        busy |= u32::from(lane.is_some()) << i;
    }
    while busy != 0 {
        let [apex, lift_off, fall] = rows.advance(&mut jet, zero);
        let mut ended = (apex | lift_off | fall) & busy;
        while ended != 0 {
            let i = ended.trailing_zeros() as usize;
            ended &= ended - 1;
            let Some(lane) = &mut lanes[i] else { continue };
            let (t_s, state) = (rows.0[TIME].0[i], rows.state(i));
            let end = if fall >> i & 1 == 1 {
                StanceEnd::Fall
            } else if lift_off >> i & 1 == 1 {
                StanceEnd::LiftOff { t_s, state }
            } else {
                StanceEnd::Apex { t_s, state }
            };
            if !queue.resume(i, lane, end, &mut rows) {
                lanes[i] = queue.refill(i, &mut rows);
                if lanes[i].is_none() {
                    busy &= !(1 << i);
                    rows.rest(i);
                }
            }
        }
    }
}

/// The jobs that are left.
struct Queue<'a, 'b> {
    jobs: &'a [Job<'b>],
    hops: &'a mut [Hop],
    begun: usize,
}

/// The hop of a lane.
#[derive(Clone, Copy)]
struct Lane {
    job: usize,
    course: Course,
}

impl Queue<'_, '_> {
    /// Begins jobs until one has a stance, which `lane` then integrates; `None` after the last.
    #[inline(never)]
    fn refill(&mut self, lane: usize, rows: &mut Rows) -> Option<Lane> {
        while let Some(Job { hopper, start, action }) = self.jobs.get(self.begun) {
            let job = self.begun;
            self.begun += 1;
            let (course, next) = hopper.begin(*start, *action);
            match next {
                Next::Stance(touchdown) => {
                    rows.set(lane, &hopper.setting(*action));
                    rows.begin(lane, touchdown);
                    return Some(Lane { job, course });
                }
                Next::End(outcome) => self.hops[job] = course.end(outcome),
            }
        }
        None
    }

    /// Continues the hop of a lane after a stance; returns whether there is another stance.
    #[inline(never)]
    fn resume(&mut self, at: usize, lane: &mut Lane, end: StanceEnd, rows: &mut Rows) -> bool {
        match self.jobs[lane.job].hopper.resume(&mut lane.course, end) {
            Next::Stance(touchdown) => {
                rows.begin(at, touchdown);
                true
            }
            Next::End(outcome) => {
                self.hops[lane.job] = lane.course.end(outcome);
                false
            }
        }
    }
}
