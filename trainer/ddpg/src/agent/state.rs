//! The state of an agent beyond its shape: everything that outlives an update.

use super::{ACTOR_PADDED, Ddpg};
use crate::net::Row;
use serde::{Deserialize, Serialize};

/// The weights of all networks, targets and averages, and the state of the optimisers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentState {
    /// Weights row by row, in the order of `Ddpg::rows`.
    #[serde(with = "crate::replay::bytes")]
    numbers: Vec<f32>,
    /// Powers of Adam's decay rates, for the actor and for the critic.
    decayed: [[f64; 2]; 2],
}

impl<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize>
    Ddpg<X, H, E, P, B>
{
    fn rows(&self) -> ([&[Row<ACTOR_PADDED>]; 5], [&[Row<P>]; 4]) {
        let (a, c) = (&self.actor_adam, &self.critic_adam);
        (
            [
                self.actor.rows(),
                self.actor_target.rows(),
                self.actor_average.rows(),
                &a.mean,
                &a.mean_square,
            ],
            [self.critic.rows(), self.critic_target.rows(), &c.mean, &c.mean_square],
        )
    }

    /// Returns the same rows as `rows`, in the same order.
    fn rows_mut(&mut self) -> ([&mut [Row<ACTOR_PADDED>]; 5], [&mut [Row<P>]; 4]) {
        let (a, c) = (&mut self.actor_adam, &mut self.critic_adam);
        (
            [
                self.actor.rows_mut(),
                self.actor_target.rows_mut(),
                self.actor_average.rows_mut(),
                &mut a.mean,
                &mut a.mean_square,
            ],
            [
                self.critic.rows_mut(),
                self.critic_target.rows_mut(),
                &mut c.mean,
                &mut c.mean_square,
            ],
        )
    }

    /// Returns the agent's state.
    pub(super) fn state(&self) -> AgentState {
        let (actor, critic) = self.rows();
        let actor = actor.into_iter().flatten().flat_map(|row| row.0);
        let critic = critic.into_iter().flatten().flat_map(|row| row.0);
        AgentState {
            numbers: actor.chain(critic).collect(),
            decayed: [self.actor_adam.decayed, self.critic_adam.decayed],
        }
    }

    /// Restores the state of an agent of the same shape; returns false when the shape differs.
    pub(super) fn restore(&mut self, state: &AgentState) -> bool {
        let (actor, critic) = self.rows();
        let length = actor.iter().map(|rows| rows.len() * ACTOR_PADDED).sum::<usize>()
            + critic.iter().map(|rows| rows.len() * P).sum::<usize>();
        if state.numbers.len() != length {
            return false;
        }
        let (actor, critic) = self.rows_mut();
        let actor = actor.into_iter().flatten().flat_map(|row| &mut row.0);
        let critic = critic.into_iter().flatten().flat_map(|row| &mut row.0);
        for (here, &there) in actor.chain(critic).zip(&state.numbers) {
            *here = there;
        }
        [self.actor_adam.decayed, self.critic_adam.decayed] = state.decayed;
        true
    }
}
