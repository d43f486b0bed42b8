//! A temporary folder and a domain of its own for the processes of one test.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};

use leg_control::actor::{ActionScaling, ObservationScaling, Widths, pack, packed_len};
use leg_control::leg::LegModel;
use leg_control::policy::{GainPoint, GainSchedule, Manifest, Media, Provenance, write};
use leg_host::Domain;
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
        let deadline = Instant::now() + LONG;
        loop {
            let status = self.request(&["status", "--json"]);
            let found = serde_json::from_str(&status.out).is_ok_and(|status| wanted(&status));
            if found {
                return;
            }
            assert!(Instant::now() < deadline, "{} {}", status.out, status.err);
        }
    }

    /// Starts a simulator that needs no other process of the test.
    pub(crate) fn alone(&self, arguments: &[&str]) -> Running {
        let policy = self.policy();
        self.start("run", &[&["--policy", text(&policy)], arguments].concat())
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

    /// Waits until both processes have been connected for a while.
    pub(crate) fn wait_for_the_run(&self, domain: Option<&str>) {
        let folder = folder_of(domain.unwrap_or(&self.domain));
        let deadline = Instant::now() + LONG;
        while !(folder.join("leg.role").exists() && folder.join("controller.role").exists()) {
            assert!(Instant::now() < deadline, "no run in {}", folder.display());
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(300));
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

/// A process, killed when dropped.
pub(crate) struct Running(Option<Child>);

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
        Self(Some(command.spawn().expect("start")))
    }

    fn child(&mut self) -> &mut Child {
        self.0.as_mut().expect("not ended yet")
    }

    pub(crate) fn pid(&mut self) -> u32 {
        self.child().id()
    }

    /// Kills the process with SIGKILL.
    pub(crate) fn kill(mut self) {
        self.child().kill().expect("kill");
        self.child().wait().expect("reap");
        self.0 = None;
    }

    /// Sends a signal to the process.
    pub(crate) fn signal(&mut self, signal: rustix::process::Signal) {
        let pid = i32::try_from(self.pid()).ok().and_then(rustix::process::Pid::from_raw);
        rustix::process::kill_process(pid.expect("a process"), signal).expect("signal");
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
        let start = Instant::now();
        while self.child().try_wait().expect("look").is_none() {
            assert!(start.elapsed() < LONG, "it hangs");
            std::thread::sleep(Duration::from_millis(2));
        }
        let took = start.elapsed();
        let Output { status, stdout, stderr } =
            self.0.take().expect("a child").wait_with_output().expect("its output");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
        Ended { status: status.code(), out: text(stdout), err: text(stderr), took }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
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
