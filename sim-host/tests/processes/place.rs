//! A temporary folder and a domain of its own for the processes of one test.

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use leg_control::actor::{
    ActionScaling, Activations, ObservationScaling, Widths, pack, packed_len,
};
use leg_control::leg::LegModel;
use leg_control::policy::{GainPoint, GainSchedule, Manifest, Media, Provenance, write};
use leg_host::{Domain, Role, json_socket};
use sim_host::operate::{LegRequest, LegStatus};
use tempfile::TempDir;

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_sim-host");
/// A user without rights.
pub(crate) const NOBODY: u32 = 65534;
/// Longest life of a process in a test.
pub(crate) const LONG: Duration = Duration::from_mins(1);

/// Isolates the processes of a test from all others.
pub(crate) struct Place {
    dir: TempDir,
    domain: String,
}

impl Place {
    pub(crate) fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let domain = format!("test-{}-{}", std::process::id(), COUNT.fetch_add(1, Relaxed));
        let place = Self { dir, domain };
        fs::write(place.policy(), hopping_in_place()).expect("write the policy");
        place
    }

    /// Returns the name of the test domain.
    pub(crate) fn domain(&self) -> &str {
        &self.domain
    }

    /// Returns the folder of the test domain, which is there while a process is in it.
    pub(crate) fn root(&self) -> PathBuf {
        folder_of(&self.domain)
    }

    /// Returns the path of a file in this place.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn policy(&self) -> PathBuf {
        self.dir.path().join("policy.bin")
    }

    /// Starts a subcommand, in the folder of this place.
    pub(crate) fn start(&self, command: &str, arguments: &[&str]) -> Running {
        let mut program = Command::new(PROGRAM);
        Running::start(program.arg(command).args(arguments).current_dir(self.dir.path()))
    }

    /// Starts the program as another user, which only the superuser can.
    pub(crate) fn start_as_nobody(&self, arguments: &[&str]) -> Running {
        // Everybody may enter, as in the system's own temporary folder, and run the program.
        fs::set_permissions(self.dir.path(), fs::Permissions::from_mode(0o777)).expect("chmod");
        let program = self.file("sim-host");
        if !program.exists() {
            fs::copy(PROGRAM, &program).expect("copy the program");
        }
        let nobody = NOBODY.to_string();
        let mut command = Command::new("setpriv");
        command.args(["--reuid", &nobody, "--regid", &nobody, "--clear-groups"]).arg(&program);
        Running::start(command.args(arguments).current_dir("/"))
    }

    /// Starts a simulator in the test domain.
    pub(crate) fn simulator(&self, arguments: &[&str]) -> Running {
        self.start("run", &[&["--domain", self.domain()], arguments].concat())
    }

    /// Starts a controller in the test domain for one run.
    pub(crate) fn controller(&self, arguments: &[&str]) -> Running {
        self.staying(&[&["--once"], arguments].concat())
    }

    /// Starts a controller in the test domain for any number of runs.
    pub(crate) fn staying(&self, arguments: &[&str]) -> Running {
        let policy = self.policy();
        let own = ["--domain", self.domain(), "--policy", text(&policy)];
        self.start("controller", &[&own, arguments].concat())
    }

    /// Sends a request to the controller by its command line.
    pub(crate) fn request(&self, what: &[&str]) -> Ended {
        self.start("controller", &[what, &["--domain", self.domain()]].concat()).end()
    }

    /// Returns the status of the controller.
    #[track_caller]
    pub(crate) fn status(&self) -> serde_json::Value {
        let status = self.request(&["status", "--json"]);
        serde_json::from_str(&status.assert_ok().out).expect("JSON")
    }

    /// Waits until the controller's status satisfies `wanted`.
    #[track_caller]
    pub(crate) fn wait_for_status(&self, wanted: impl Fn(&serde_json::Value) -> bool) {
        wait_for_status_in(self.domain(), wanted);
    }

    /// Waits until the controller waits for a leg.
    #[track_caller]
    pub(crate) fn wait_for_the_controller(&self) {
        self.wait_for_status(|status| status["activity"] == "waiting");
    }

    /// Returns the status of the leg, which must be in a run.
    #[track_caller]
    pub(crate) fn leg_status(&self) -> LegStatus {
        self.ask_the_leg(&LegRequest::Status)
    }

    /// Ends the run in order, so that it prints its result.
    #[track_caller]
    pub(crate) fn end_the_run(&self) {
        self.ask_the_leg(&LegRequest::Quit);
    }

    #[track_caller]
    fn ask_the_leg(&self, request: &LegRequest) -> LegStatus {
        json_socket::ask(self.domain(), Role::Leg, request, LONG).expect("an answer of the leg")
    }

    /// Returns a run of as many ticks without a second process, for comparison.
    #[track_caller]
    pub(crate) fn alone_for(&self, ticks: u64, arguments: &[&str]) -> Ended {
        let duration = (ticks as f64 / 1000.0).to_string();
        let own = ["--in-process", "--duration", &duration];
        let ended = self.alone(&[&own[..], arguments].concat()).end();
        ended.assert_ok();
        ended
    }

    /// Starts a simulator that needs no other process of the test.
    pub(crate) fn alone(&self, arguments: &[&str]) -> Running {
        let policy = self.policy();
        self.start("run", &[&["--policy", text(&policy)], arguments].concat())
    }

    /// Starts a simulator that needs no other process of the test, in a process group of its own
    /// as of a shell's job.
    pub(crate) fn job(&self, arguments: &[&str]) -> Running {
        let mut program = Command::new(PROGRAM);
        program.args(["run", "--policy"]).arg(self.policy()).args(arguments).process_group(0);
        Running::start(program.current_dir(self.dir.path()))
    }

    /// Starts the demonstration, with its picture in `folder`.
    pub(crate) fn shore(&self, folder: &Path) -> Running {
        self.start("--out", &[text(folder)])
    }

    /// Starts the demonstration without options, in this place's directory.
    pub(crate) fn demonstration(&self) -> Running {
        Running::start(Command::new(PROGRAM).current_dir(self.dir.path()))
    }

    /// Starts the program from a shell, after other commands of the shell.
    pub(crate) fn start_after(&self, commands: &str, arguments: &[&str]) -> Running {
        let program = format!("{commands} && exec \"$0\" \"$@\"");
        let mut shell = Command::new("sh");
        shell.args(["-c", &program, PROGRAM]).args(arguments);
        Running::start(shell.current_dir(self.dir.path()))
    }

    /// Starts the program from a shell with mounts of its own, after these commands.
    pub(crate) fn start_with_mounts(&self, commands: &str, arguments: &[&str]) -> Running {
        let program = format!("{commands} && exec \"$0\" \"$@\"");
        let mut shell = Command::new("unshare");
        shell.args(["--mount", "--", "sh", "-c", &program, PROGRAM]);
        Running::start(shell.args(arguments).current_dir(self.dir.path()))
    }

    /// Waits until the controller has answered samples of the run in this or the named domain.
    #[track_caller]
    pub(crate) fn wait_for_the_run(&self, domain: Option<&str>) {
        wait_for_status_in(domain.unwrap_or(&self.domain), |status| {
            status["activity"] != "waiting" && status["ticks"].as_u64() > Some(0)
        });
    }

    /// Asserts that nothing is left of the test domain or of the named one.
    #[track_caller]
    pub(crate) fn assert_clean_of(&self, domain: Option<&str>) {
        let domain = domain.unwrap_or(&self.domain);
        let folder = folder_of(domain);
        assert!(!folder.exists(), "left: {:?}", tree(&folder));
        let prefix = format!("leg-{}-{domain}-", rustix::process::getuid().as_raw());
        let left: Vec<_> = fs::read_dir("/dev/shm")
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.file_name())
            .filter(|name| name.to_string_lossy().starts_with(&prefix))
            .collect();
        assert!(left.is_empty(), "left in shared memory: {left:?}");
    }

    #[track_caller]
    pub(crate) fn assert_clean(&self) {
        self.assert_clean_of(None);
    }
}

impl Drop for Place {
    /// Removes what killed processes of a failed test left.
    fn drop(&mut self) {
        if self.root().exists() {
            let _ = Domain::join(&self.domain);
        }
    }
}

/// Returns the folder of a domain.
pub(crate) fn folder_of(domain: &str) -> PathBuf {
    Domain::folder(domain).expect("a valid name")
}

fn tree(path: &Path) -> Vec<PathBuf> {
    let mut all = vec![path.to_owned()];
    for entry in fs::read_dir(path).into_iter().flatten().flatten() {
        all.extend(tree(&entry.path()));
    }
    all
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a temporary folder with a plain name")
}

/// Waits until the status of the controller in a domain satisfies `wanted`.
#[track_caller]
fn wait_for_status_in(domain: &str, wanted: impl Fn(&serde_json::Value) -> bool) {
    wait_until(|| {
        let mut command = Command::new(PROGRAM);
        let status = ["controller", "status", "--json", "--domain", domain];
        let Ended { out, err, .. } = Running::start(command.args(status)).end();
        let is_so = serde_json::from_str(&out).is_ok_and(|status| wanted(&status));
        if is_so { Ok(()) } else { Err(format!("{out} {err}")) }
    });
}

/// Waits until something is so; panics with what it is instead after [`LONG`].
#[track_caller]
pub(crate) fn wait_until(mut look: impl FnMut() -> Result<(), String>) {
    let start = Instant::now();
    while let Err(what) = look() {
        assert!(start.elapsed() < LONG, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// What a process has printed so far, and the thread that reads on.
struct Printed {
    text: Arc<Mutex<Vec<u8>>>,
    thread: JoinHandle<()>,
}

impl Printed {
    fn read(mut from: impl Read + Send + 'static) -> Self {
        let text = Arc::<Mutex<Vec<u8>>>::default();
        let written = Arc::clone(&text);
        let thread = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(n @ 1..) = from.read(&mut bytes) {
                written.lock().unwrap().extend_from_slice(&bytes[..n]);
            }
        });
        Self { text, thread }
    }

    fn so_far(&self) -> String {
        String::from_utf8_lossy(&self.text.lock().unwrap()).into_owned()
    }

    /// Returns all that was printed, by the process and its children.
    fn all(self) -> String {
        self.thread.join().expect("a reader");
        String::from_utf8(std::mem::take(&mut self.text.lock().unwrap())).expect("text")
    }
}

/// A process, killed when dropped.
pub(crate) struct Running {
    child: Child,
    started: Instant,
    output: Option<[Printed; 2]>,
}

/// Exit status, output and duration of a process.
pub(crate) struct Ended {
    pub(crate) status: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
    pub(crate) took: Duration,
}

impl Running {
    /// Starts a command, without input and with its output kept.
    pub(crate) fn start(command: &mut Command) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let started = Instant::now();
        let mut child = command.spawn().expect("start");
        let out = Printed::read(child.stdout.take().expect("piped"));
        let err = Printed::read(child.stderr.take().expect("piped"));
        Self { child, started, output: Some([out, err]) }
    }

    pub(crate) fn pid(&mut self) -> u32 {
        self.child.id()
    }

    /// Waits until the process has printed this on the standard error.
    #[track_caller]
    pub(crate) fn wait_for_message(&self, text: &str) {
        let [_, err] = self.output.as_ref().expect("not ended yet");
        wait_until(|| {
            let so_far = err.so_far();
            so_far.contains(text).then_some(()).ok_or(format!("`{text}` is not in: {so_far}"))
        });
    }

    /// Waits until the process has printed a line on the standard output that has this, and
    /// returns what follows it there.
    #[track_caller]
    pub(crate) fn wait_for_line(&self, text: &str) -> String {
        let [out, err] = self.output.as_ref().expect("not ended yet");
        let mut rest = None;
        wait_until(|| {
            let so_far = out.so_far();
            let found = so_far.lines().find_map(|line| Some(line.split_once(text)?.1.to_owned()));
            rest = found.filter(|_| so_far.ends_with('\n'));
            rest.as_ref()
                .map(|_| ())
                .ok_or(format!("`{text}` is not in: {so_far} {}", err.so_far()))
        });
        rest.expect("found")
    }

    /// Kills the process with SIGKILL.
    pub(crate) fn kill(mut self) {
        self.child.kill().expect("kill");
        self.child.wait().expect("reap");
    }

    /// Sends a signal to the process.
    pub(crate) fn signal(&mut self, signal: rustix::process::Signal) {
        let pid = i32::try_from(self.pid()).ok().and_then(rustix::process::Pid::from_raw);
        rustix::process::kill_process(pid.expect("a process"), signal).expect("signal");
    }

    /// Sends a signal to all processes of a job, as a terminal does.
    pub(crate) fn signal_job(&mut self, signal: rustix::process::Signal) {
        let pid = i32::try_from(self.pid()).ok().and_then(rustix::process::Pid::from_raw);
        rustix::process::kill_process_group(pid.expect("a process"), signal).expect("signal");
    }

    /// Sends a signal to each child of the process.
    pub(crate) fn signal_children(&mut self, signal: rustix::process::Signal) {
        let pid = self.pid();
        let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
        for child in children.expect("the list of children").split_whitespace() {
            let pid = child.parse().ok().and_then(rustix::process::Pid::from_raw);
            rustix::process::kill_process(pid.expect("a process"), signal).expect("signal");
        }
    }

    /// Waits until the process ends.
    #[track_caller]
    pub(crate) fn end(mut self) -> Ended {
        let (child, output) = (&mut self.child, self.output.take().expect("not ended yet"));
        let mut status = None;
        wait_until(|| {
            status = child.try_wait().expect("look");
            let hangs = || format!("it hangs: {:?}", output.each_ref().map(Printed::so_far));
            if status.is_some() { Ok(()) } else { Err(hangs()) }
        });
        let took = self.started.elapsed();
        let [out, err] = output.map(Printed::all);
        Ended { status: status.and_then(|status| status.code()), out, err, took }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Ended {
    /// Asserts the exit status, and that stderr contains each of `parts`.
    #[track_caller]
    pub(crate) fn assert(&self, status: i32, parts: &[impl AsRef<OsStr>]) -> &Self {
        assert_eq!(self.status, Some(status), "out: {} err: {}", self.out, self.err);
        for part in parts {
            let part = part.as_ref().to_str().expect("text");
            assert!(self.err.contains(part), "`{part}` is not in: {}", self.err);
        }
        self
    }

    #[track_caller]
    pub(crate) fn assert_ok(&self) -> &Self {
        self.assert(0, &[] as &[&str])
    }

    /// Returns the number of ticks printed by a run.
    #[track_caller]
    pub(crate) fn ticks(&self) -> u64 {
        let before = self.out.split_once(" ticks)").map(|(before, _)| before);
        let ticks = before.and_then(|before| before.rsplit_once('(')?.1.parse().ok());
        ticks.unwrap_or_else(|| panic!("no ticks in: {}", self.out))
    }

    /// Returns the state hash printed by a run.
    #[track_caller]
    pub(crate) fn state_hash(&self) -> String {
        let hash = self.out.split_once("state hash ").map(|(_, rest)| rest.trim().to_owned());
        hash.unwrap_or_else(|| panic!("no hash in: {}", self.out))
    }
}

/// Returns a policy that hops in place in air: the leg is upright, a little ahead of
/// a moving mass, and never extends.
fn hopping_in_place() -> Vec<u8> {
    hopping_named("hop in place")
}

/// Returns the same policy under another name, so that its file differs.
pub(crate) fn hopping_named(name: &str) -> Vec<u8> {
    let widths = Widths::from_slice(&[3, 2]).expect("two widths");
    let mut packed = Vec::with_capacity(packed_len(&widths).expect("an actor"));
    // Rows: angle, elongation speed; columns: velocity, height, density.
    pack(&[0.12, 0.0, 0.0, 0.0, 0.0, 0.0], &[0.0, 0.0], 3, |w| packed.push(w));
    let manifest = Manifest {
        name,
        widths,
        activations: Activations::default(),
        observation: ObservationScaling::IDENTITY,
        action: ActionScaling {
            scale: [1.0, 1.0],
            offset: [std::f32::consts::FRAC_PI_2, 0.0],
            low: [0.4, 0.0],
            high: [2.7, 2.0],
        },
        leg: LegModel::HUMAN,
        media: Media { density_ratio: [0.0, 1.0], gravity_m_s2: [9.81, 9.81] },
        provenance: Provenance {
            preset: "test",
            seed: 0,
            steps: 0,
            trainer_version: "0",
            config: "",
        },
        gains: GainSchedule::from_slice(&[GainPoint { limit_m_s: 1.0, ..GainPoint::default() }])
            .expect("one point"),
    };
    let mut buffer = vec![0_u32; 4096];
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut buffer);
    let len = write(&manifest, &packed, buffer).expect("a policy");
    buffer[..len].to_vec()
}
