//! Bare iceoryx2: a publisher and a polled subscriber in each direction, with the
//! settings of the link and nothing else.

use anyhow::Context;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Node, NodeBuilder, SignalHandlingMode, ZeroCopySend, ipc};
use leg_host::discovery::Session;
use leg_host::{Domain, shm};

use super::{Ping, Pong, spin_for};

const PINGS: &str = "bench/pings";
const PONGS: &str = "bench/pongs";

/// One end of the exchange.
struct End<
    Out: ZeroCopySend + std::fmt::Debug + 'static,
    In: ZeroCopySend + std::fmt::Debug + 'static,
> {
    publisher: Publisher<ipc::Service, Out, ()>,
    subscriber: Subscriber<ipc::Service, In, ()>,
    _node: Node<ipc::Service>,
}

impl<Out, In> End<Out, In>
where
    Out: ZeroCopySend + Copy + std::fmt::Debug + 'static,
    In: ZeroCopySend + Copy + std::fmt::Debug + 'static,
{
    fn open(domain: &Domain, out: &str, back: &str) -> anyhow::Result<Self> {
        let session =
            Session { prefix: domain.prefix().to_owned(), folder: domain.root().to_owned() };
        let config = shm::config(&session).map_err(anyhow::Error::msg)?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()?;
        let publisher = service::<Out>(&node, out)?.publisher_builder().create()?;
        let subscriber = service::<In>(&node, back)?.subscriber_builder().create()?;
        Ok(Self { publisher, subscriber, _node: node })
    }

    fn send(&self, message: Out) -> anyhow::Result<()> {
        self.publisher.send_copy(message).map(|_| ()).context("cannot send")
    }

    fn receive(&self) -> anyhow::Result<In> {
        spin_for(|| Ok(self.subscriber.receive()?.map(|message| *message)))
    }
}

type Service<T> =
    iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, T, ()>;

fn service<T: ZeroCopySend + std::fmt::Debug + 'static>(
    node: &Node<ipc::Service>,
    name: &str,
) -> anyhow::Result<Service<T>> {
    Ok(node
        .service_builder(&name.try_into()?)
        .publish_subscribe::<T>()
        .max_publishers(1)
        .subscriber_max_buffer_size(1)
        .subscriber_max_borrowed_samples(1)
        .history_size(0)
        .enable_safe_overflow(true)
        .open_or_create()?)
}

/// The end that sends first.
pub(super) struct Requester(End<Ping, Pong>);

impl Requester {
    pub(super) fn open(domain: &Domain) -> anyhow::Result<Self> {
        End::open(domain, PINGS, PONGS).map(Self)
    }

    pub(super) fn exchange(&mut self, i: u64) -> anyhow::Result<()> {
        self.0.send([i; 6])?;
        let pong = self.0.receive()?;
        anyhow::ensure!(pong == [i; 8], "sent {i}, received {pong:?}");
        Ok(())
    }
}

/// The end that echoes.
pub(super) struct Responder(End<Pong, Ping>);

impl Responder {
    pub(super) fn open(domain: &Domain) -> anyhow::Result<Self> {
        End::open(domain, PONGS, PINGS).map(Self)
    }

    pub(super) fn respond(&mut self, times: u64) -> anyhow::Result<()> {
        for _ in 0..times {
            let ping = self.0.receive()?;
            self.0.send([ping[0]; 8])?;
        }
        Ok(())
    }
}
