//! Looking after the peer beside a loop in real time.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use super::super::card::Role;
use super::super::link::LinkError;
use super::super::payload::Message;
use super::super::shm::{Keeper, Peer, ShmLink, Turn};
use leg_process::signals::Stop;

/// The end of a loop's patience: how the peer was lost that has not come back.
pub type GaveUp = Arc<OnceLock<LinkError>>;

/// What the supervisor of the loop of `link` is to do: the returned function
/// looks whether the peer is there, and says on stderr who was lost, or refused.
/// With a `patience`, a peer that is gone for longer than that ends the loop, by
/// `stop`, and is named in the returned cell. Whoever comes is shown to `greet`.
pub fn watch<Out: Message, In: Message, G: FnMut(Peer) + Send>(
    link: &ShmLink<Out, In>,
    stop: &Stop,
    patience: Option<Duration>,
    mut greet: G,
) -> (GaveUp, impl FnMut() + Send + use<Out, In, G>) {
    let gave_up = GaveUp::default();
    let (keeper, stop, told) = (link.keeper(), stop.clone(), Arc::clone(&gave_up));
    let mut lost: Option<(Instant, LinkError)> = None;
    let look = move || {
        match look(&keeper, Out::SENDER) {
            Some(Turn::Lost(cause)) => lost = Some((Instant::now(), cause)),
            Some(Turn::Met(peer)) => {
                lost = None;
                greet(peer);
            }
            Some(Turn::Refused(_)) | None => (),
        }
        if let (Some((since, cause)), Some(patience)) = (&lost, patience)
            && since.elapsed() >= patience
        {
            let _ = told.set(cause.clone());
            stop.raise();
        }
    };
    (gave_up, look)
}

fn look<Out: Message, In: Message>(keeper: &Keeper<Out, In>, role: Role) -> Option<Turn> {
    match keeper.look() {
        Ok(turn) => {
            match &turn {
                // Before the end of its run or after: the clerk says, who hears it.
                Some(Turn::Lost(LinkError::PeerLeft { role: peer, pid })) => {
                    eprintln!("{role}: the {peer} (process {pid}) has left");
                }
                Some(turn @ (Turn::Lost(_) | Turn::Refused(_))) => eprintln!("{role}: {turn}"),
                // That one is back, the clerk says too.
                Some(Turn::Met(_)) | None => (),
            }
            turn
        }
        // Tried again at the next look.
        Err(_) => None,
    }
}
