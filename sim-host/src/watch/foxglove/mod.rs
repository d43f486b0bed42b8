//! A running leg served to Foxglove over a WebSocket: the topics of a recording, made by the same
//! code, and what the keys of the view in the terminal do as parameters and services.

mod operator;

use std::io::{self, ErrorKind};
use std::net::Ipv6Addr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foxglove::{
    Context, FoxgloveError, PartialMetadata, RawChannel, WebSocketServer, WebSocketServerHandle,
};
use leg_host::TimeMode;
use leg_host::shm::ConnectError;
use leg_process::Stop;

use super::feed::Feed;
use super::scene::Scene;
use crate::record::{ChangePoller, LiveMessages, ObservedRun, TickCopy, now_unix_ns, topics};
use operator::{Operator, Values};

/// Time between two polls of the newest messages. A viewer draws fewer pictures.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Pictures per second of simulated time, at most one for each poll.
const DISPLAY_RATE_HZ: u32 = 50;
/// How long to wait for the status of a leg or a controller: those of other programs have none.
const STATUS_TIMEOUT: Duration = Duration::from_secs(1);
/// Least time between two drawings of the ground because the density has changed.
const DENSITY_INTERVAL: Duration = Duration::from_millis(500);
/// Change of the density ratio that can be seen.
const DENSITY_STEP: f64 = 0.01;
/// Gravity where the controller does not tell it, m/s2.
const USUAL_GRAVITY_M_S2: f32 = 9.81;

/// Why nothing can be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The domain's name is invalid.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// Another program has the port.
    #[error("port {port} of {host} is in use by another program")]
    InUse {
        /// The host.
        host: String,
        /// The port.
        port: u16,
    },
    /// The system refuses the address.
    #[error("cannot listen at {host}:{port}: {cause}")]
    Bind {
        /// The host.
        host: String,
        /// The port.
        port: u16,
        /// The error of the system.
        cause: io::Error,
    },
    /// Foxglove's library fails.
    #[error("the server for Foxglove cannot start: {0}")]
    Server(#[from] FoxgloveError),
    /// Signals cannot be handled, or no thread be started.
    #[error(transparent)]
    System(#[from] io::Error),
}

/// Serves `domain` at this address, port 0 for any that is free, until a signal arrives.
/// `started` is called once with the port.
///
/// # Errors
/// [`ServeError`], or that of `started`.
pub fn serve<E: From<ServeError>>(
    domain: &str,
    host: &str,
    port: u16,
    started: impl FnOnce(u16) -> Result<(), E>,
) -> Result<(), E> {
    let mut feed = Feed::begin(domain).map_err(ServeError::from)?;
    let stop = Stop::on_signals().map_err(ServeError::from)?;
    let mut server = Server::start(domain, host, port)?;
    started(server.handle.port())?;
    let mut scene = Scene::new(domain);
    while !stop.is_raised() {
        feed.update(&mut scene);
        server.update(&mut scene);
        std::thread::sleep(POLL_INTERVAL);
    }
    // Clients that do not close their connection are not waited for.
    drop(server.handle.stop());
    Ok(())
}

/// The server, and the run that it shows.
struct Server {
    domain: String,
    handle: WebSocketServerHandle,
    /// Of the channels, which end with it.
    _context: Arc<Context>,
    /// By the numbers of the topics.
    channels: Vec<Arc<RawChannel>>,
    operator: Arc<Operator>,
    run: Option<Run>,
    /// Since when there are samples of a run of which nothing else is known.
    since: Option<Instant>,
    /// Latest time of a message, ns since 1970 began: time goes on from run to run.
    latest_ns: u64,
}

/// A run that is shown.
struct Run {
    live: LiveMessages,
    _changes: ChangePoller,
    /// Run id and number of the last sample, and number of the last command.
    last: Option<(u32, u64, u64)>,
    /// The density for which the ground is drawn, and when that was.
    drawn: (f64, Instant),
}

impl Server {
    fn start(domain: &str, host: &str, port: u16) -> Result<Self, ServeError> {
        let context = Context::new();
        let channel = |(name, schema): (&str, _)| {
            context.channel_builder(name).schema(schema).message_encoding("protobuf").build_raw()
        };
        let channels = topics().into_iter().map(channel).collect::<Result<_, _>>()?;
        let operator = Operator::begin(domain)?;
        let address = match host.parse::<Ipv6Addr>() {
            Ok(host) => format!("[{host}]"),
            Err(_) => host.to_owned(),
        };
        let server = WebSocketServer::new()
            .name(format!("spring leg, domain {domain}"))
            .context(&context)
            .bind(address, port)
            .listener(Arc::<Operator>::clone(&operator))
            .parameter_handler(Arc::<Operator>::clone(&operator))
            .services(operator.services());
        let handle = server.start_blocking().map_err(|error| match error {
            FoxgloveError::Bind(cause) if cause.kind() == ErrorKind::AddrInUse => {
                ServeError::InUse { host: host.to_owned(), port }
            }
            FoxgloveError::Bind(cause) => ServeError::Bind { host: host.to_owned(), port, cause },
            error => error.into(),
        })?;
        Ok(Self {
            domain: domain.to_owned(),
            handle,
            _context: context,
            channels,
            operator,
            run: None,
            since: None,
            latest_ns: 0,
        })
    }

    /// Sends what is new in the scene.
    fn update(&mut self, scene: &mut Scene) {
        if scene.take_cleared() {
            (self.run, self.since) = (None, None);
        }
        let changed = self.operator.take(Values::of(scene));
        if let Some(values) = changed {
            self.handle.publish_parameter_values(values.parameters());
        }
        let (Some(sample), Some(command)) = (scene.sample, scene.command) else { return };
        let density_ratio = scene.density_ratio().unwrap_or_default();
        if self.run.is_none() {
            let since = *self.since.get_or_insert_with(Instant::now);
            let Some(run) = observed_run(scene, since.elapsed() >= STATUS_TIMEOUT) else { return };
            let begun_ns = now_unix_ns().saturating_sub(sample.header.t_ns);
            let Ok(config) = run.config(begun_ns.max(self.latest_ns)) else { return };
            let (live, sink) = LiveMessages::begin(config, DISPLAY_RATE_HZ);
            let changes = ChangePoller::begin(&self.domain, sample.header.run_id, sink);
            let drawn = (density_ratio, Instant::now());
            self.run = Some(Run { live, _changes: changes, last: None, drawn });
        }
        let Some(run) = &mut self.run else { return };
        let (drawn, when) = run.drawn;
        let has_changed = (density_ratio - drawn).abs() > DENSITY_STEP;
        let is_wanted = self.operator.take_subscribed();
        if is_wanted || has_changed && when.elapsed() >= DENSITY_INTERVAL {
            run.live.repeat(density_ratio);
            run.drawn = (density_ratio, Instant::now());
        }
        let this = (sample.header.run_id, sample.header.seq, command.header.seq);
        if is_wanted || run.last.is_none_or(|last| (last.0, last.1) != (this.0, this.1)) {
            let is_new = run.last.is_none_or(|last| last.2 != this.2);
            run.last = Some(this);
            let tick = TickCopy::observed(&sample, &command, is_new, scene.leg(), density_ratio);
            run.live.tick(&tick);
        }
        run.live.take(|topic, log_time_ns, message| {
            let meta = PartialMetadata { log_time: Some(log_time_ns) };
            self.channels[topic].log_with_meta(message, meta);
        });
        self.latest_ns = run.live.latest_ns();
    }
}

/// Returns what is known of a run: by the status of the leg or of the controller, otherwise
/// once `by_messages` by the messages alone.
fn observed_run(scene: &Scene, by_messages: bool) -> Option<ObservedRun> {
    let header = scene.sample?.header;
    let (leg, controller) = (scene.leg.as_ref(), scene.controller.as_ref());
    let rate_hz = leg.map(|leg| leg.rate_hz).or(controller.map(|controller| controller.rate_hz));
    let by_time = || (1e9 * header.seq as f64 / header.t_ns.max(1) as f64).round() as u32;
    let time_mode = leg.map(|leg| leg.time_mode).or(controller.map(|now| now.time_mode));
    Some(ObservedRun {
        rate_hz: rate_hz.or_else(|| by_messages.then(by_time))?,
        gravity_m_s2: controller.map_or(USUAL_GRAVITY_M_S2, |controller| controller.gravity_m_s2),
        time_mode: time_mode.unwrap_or(TimeMode::LockStep),
        density_ratio: scene.density_ratio().unwrap_or_default().clamp(0.0, 1.0),
    })
}
