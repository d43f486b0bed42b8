//! Replays a run in lock-step whose link had faults.
//!
//! The recorded samples are those that the leg sent, and a fault changed them on their way. Faults are
//! the same for the same seed, so they are injected anew: the controller under replay receives
//! what the recorded one received, and its commands arrive as they did.

use std::cell::Cell;
use std::collections::VecDeque;
use std::time::Duration;

use leg_control::wire::{Command, Header, Sample};
use leg_control::wire_controller::WireController;
use leg_host::LegLink;
use leg_host::memory::Inline;
use leg_host::recorded::{SetPoints, Swap};

use super::Observe;
use super::compare::difference;
use super::controller::Continuity;
use super::report::ReplayReport;
use super::source::Answer;
use crate::faults::stage::{FaultPlan, FaultyLink, SteppedLink};
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::AnyMessage;
use crate::record::schema::{self, LOCK_STEP};
use crate::scenario::{Scenario, Settings};

/// The recorded law at its start, with the policies and set-points that come to it.
pub(super) struct Recorded<'a> {
    pub(super) controller: WireController<'a>,
    pub(super) swaps: VecDeque<Swap<'a>>,
    pub(super) set_points: &'a SetPoints,
}

/// The faults of a run that can be injected anew.
pub(super) struct Faulted {
    plan: FaultPlan,
    /// Leg and controller stepped in turn in one thread.
    stepped: bool,
}

impl Faulted {
    /// Returns the faults of a recording; `None` if it has none, or they depend on time.
    pub(super) fn of(contents: &Contents) -> Result<Option<Self>, ReadError> {
        let schema::Config { time_mode, .. } = contents.config()?;
        let Some(law) = contents.laws.first().filter(|_| time_mode == LOCK_STEP) else {
            return Ok(None);
        };
        Ok(link_faults(contents.config()?).map(|plan| Self { plan, stepped: law.stepped }))
    }

    /// Plays the recorded samples to `controller` and compares its commands, of another policy if
    /// `is_other`.
    pub(super) fn follow(
        self,
        contents: &Contents,
        law: Recorded<'_>,
        is_other: bool,
        report: &mut ReplayReport,
        observe: Observe<'_>,
    ) -> Result<(), ReadError> {
        let Recorded { mut controller, mut swaps, set_points } = law;
        let tick = Cell::new((0, 0));
        let estimate = Cell::new(None);
        let unknown = Cell::new(None);
        let mut last = Header::default();
        let law = |sample: Option<&Sample>| {
            while let Some(swap) = swaps.pop_front_if(|swap| swap.at <= tick.get()) {
                match swap.policy {
                    Some(policy) => controller.swap(policy),
                    None => unknown.set(unknown.get().or(Some(swap.at.1))),
                }
            }
            let command = set_points.tick(&mut controller, sample, &last);
            estimate.set(controller.estimate());
            last = sample.map_or(last, |sample| sample.header);
            command
        };
        let mut observe = |at| {
            if let Some(estimate) = estimate.take() {
                observe(at, estimate);
            }
        };
        let (tick, unknown, observe) = (&tick, &unknown, &mut observe);
        if self.stepped {
            let mut link = SteppedLink::new(law, self.plan);
            play(contents, &mut link, tick, unknown, is_other, report, observe)
        } else {
            let mut law = law;
            let inline = Inline::new(move |sample: &Sample| law(Some(sample)));
            let mut link = FaultyLink::at_leg(inline, self.plan).in_lock_step();
            play(contents, &mut link, tick, unknown, is_other, report, observe)
        }
    }
}

/// Returns the faults of a recording's link, from the start of the run; `None` if there are none
/// or its scenario is not valid here.
pub(super) fn link_faults(config: &schema::Config) -> Option<FaultPlan> {
    let settings = Settings::from_toml(&config.scenario_toml).ok()?;
    let plan = Scenario::from_settings(&settings).ok()?.faults.plan();
    (!plan.is_empty()).then_some(plan)
}

/// Sends each recorded sample and compares the command that comes back with the recorded one.
fn play(
    contents: &Contents,
    link: &mut impl LegLink,
    tick: &Cell<(u32, u64)>,
    unknown_policy: &Cell<Option<u64>>,
    is_other: bool,
    report: &mut ReplayReport,
    observe: &mut dyn FnMut((u32, u64)),
) -> Result<(), ReadError> {
    let mut messages = contents.messages()?;
    let mut sample: Option<Sample> = None;
    let mut next = 0;
    while let Some(message) = messages.next_message()? {
        let recorded = match message {
            AnyMessage::Sample(recorded) => {
                sample = Some((&recorded).into());
                continue;
            }
            AnyMessage::Command(recorded) => recorded,
            _ => continue,
        };
        let seq = recorded.tick;
        let Some(sample) = sample.take().filter(|s| s.header.seq == seq && seq == next) else {
            report.stop(format!(
                "ticks {next} to {seq} are not all in the recording; the faults and the \
                 controller's state after them are unknown"
            ));
            break;
        };
        next += 1;
        tick.set((sample.header.run_id, seq));
        // Within a thread neither call fails.
        let sent = link.send(&sample);
        let replayed = sent.and_then(|()| link.receive(Duration::ZERO)).unwrap_or(None);
        observe(tick.get());
        if let Some(seq) = unknown_policy.get() {
            report.stop(format!(
                "at tick {seq} the controller received a policy that the recording does not contain"
            ));
            break;
        }
        if !recorded.is_new {
            report.unanswered += 1;
            continue;
        }
        let command = Command::from(&recorded);
        let answer = Answer { sample, unanswered: Vec::new(), command, gap: None };
        let replayed = replayed.unwrap_or_default();
        match difference(&command, &replayed) {
            _ if is_other => report.add_other(&answer, &replayed),
            None => report.add_same(&answer, Continuity::Continued),
            Some(difference) => {
                report.add_different(&answer, difference);
                break;
            }
        }
    }
    Ok(())
}
