//! [`Cluster`]: the scheduler Slurm with one node on this machine.
//!
//! `cargo xtask test` unpacks it from the machine's own release of Debian into a folder. It runs as the
//! user of the test, without cgroups, and writes to a temporary folder only.

use std::env::consts::ARCH;
use std::fs;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;
use xtask::workspace;

use crate::programs::run;

/// Reason to ignore a test that needs the scheduler.
pub const MISSING: &str = "no Slurm for tests; cargo xtask test gets one where Debian's packages can be had";

/// Longest wait for the node.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running scheduler; ends when dropped.
pub struct Cluster {
    services: Vec<Child>,
    root: PathBuf,
    folder: TempDir,
}

impl Cluster {
    /// Starts a scheduler; `None` if none is unpacked.
    ///
    /// # Panics
    /// If it does not work.
    pub fn start() -> Option<Cluster> {
        let root = workspace::slurm_folder();
        if !root.is_dir() {
            return None;
        }
        let folder = tempfile::tempdir().expect("temporary files can be made");
        let mut cluster = Cluster { services: Vec::new(), root, folder };
        for name in ["state", "spool"] {
            fs::create_dir(cluster.path(name)).expect("temporary files can be made");
        }
        cluster.start_munge();
        fs::write(cluster.path("slurm.conf"), cluster.configuration())
            .expect("temporary files can be written");
        cluster.serve("usr/sbin/slurmctld-wlm", &["-D", "-c"]);
        let step = cluster.root.join("usr/sbin/slurmstepd-wlm");
        cluster.serve("usr/sbin/slurmd-wlm", &["-D", "-d", step.to_str().expect("a path in text")]);
        cluster.wait("the node is not idle", |cluster| {
            let nodes = run(cluster.command("sinfo").args(["--noheader", "--format=%T"]));
            nodes.stdout.trim() == "idle"
        });
        Some(cluster)
    }

    /// Starts munged, which authenticates the services' messages.
    fn start_munge(&mut self) {
        let key: Vec<u8> = (0..1024).map(|_| fastrand::u8(..)).collect();
        fs::write(self.path("key"), key).expect("temporary files can be written");
        let private = std::os::unix::fs::PermissionsExt::from_mode(0o400);
        fs::set_permissions(self.path("key"), private).expect("it is ours");
        let options = [("key-file", "key"), ("socket", "munge"), ("pid-file", "munge.pid")];
        let more = [("log-file", "munge.log"), ("seed-file", "munge.seed")];
        let mut args = vec!["--foreground".to_owned(), "--force".to_owned()];
        for (option, name) in options.into_iter().chain(more) {
            args.push(format!("--{option}={}", self.path(name).display()));
        }
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        self.serve("usr/sbin/munged", &args);
        self.wait("munged does not answer", |cluster| cluster.path("munge").exists());
    }

    /// Contents of slurm.conf, which all programs read.
    fn configuration(&self) -> String {
        let host = fs::read_to_string("/proc/sys/kernel/hostname").expect("the system has a name");
        let host = host.trim().split('.').next().unwrap_or_default();
        let user = run(Command::new("id").arg("-un")).stdout;
        let user = user.trim();
        // The system hands out other ports first, so these stay free until the services bind them.
        let ports =
            [0; 2].map(|_| TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("there is a free port"));
        let [controller, node] = ports.map(|port| port.local_addr().expect("it is bound").port());
        let folder = self.folder.path().display();
        let plugins = self.libraries().join("slurm-wlm");
        format!(
            "ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge
SlurmctldPort={controller}
SlurmdPort={node}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
PluginDir={}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1
NodeName={host} NodeAddr=127.0.0.1 CPUs=1 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
",
            plugins.display()
        )
    }

    fn libraries(&self) -> PathBuf {
        self.root.join(format!("usr/lib/{ARCH}-linux-gnu"))
    }

    /// A path in the folder of the scheduler, which goes with it.
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command for one of its programs.
    pub fn command(&self, program: &str) -> Command {
        self.with_environment(Command::new(self.root.join("usr/bin").join(program)))
    }

    fn with_environment(&self, mut command: Command) -> Command {
        let libraries = [self.libraries().join("slurm-wlm"), self.libraries()];
        let libraries = std::env::join_paths(libraries).expect("folders of the workspace have no colon");
        command.env("LD_LIBRARY_PATH", libraries).env("SLURM_CONF", self.path("slurm.conf"));
        command
    }

    /// Starts a service, which ends with this process, however that ends.
    fn serve(&mut self, program: &str, args: &[&str]) {
        let log = fs::File::options().append(true).create(true).open(self.path("log"));
        let log = log.expect("temporary files can be made");
        let mut command = self.with_environment(Command::new("setpriv"));
        command.args(["--pdeathsig", "KILL"]).arg(self.root.join(program)).args(args);
        command.stdin(Stdio::null()).stdout(log.try_clone().expect("a file can be shared")).stderr(log);
        let service = command.spawn().unwrap_or_else(|error| panic!("setpriv {program}: {error}"));
        self.services.push(service);
    }

    /// Waits for something.
    fn wait(&mut self, what: &str, is_so: impl Fn(&Cluster) -> bool) {
        let start = Instant::now();
        while !is_so(self) {
            let ended = |service: &mut Child| service.try_wait().is_ok_and(|status| status.is_some());
            let log = |cluster: &Cluster| fs::read_to_string(cluster.path("log")).unwrap_or_default();
            assert!(!self.services.iter_mut().any(ended), "{what}: a service ended: {}", log(self));
            assert!(start.elapsed() < PATIENCE, "{what}: {}", log(self));
            sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        for service in self.services.iter_mut().rev() {
            // It may have ended already.
            let _ = service.kill();
            let _ = service.wait();
        }
    }
}

/// A path quoted for a shell.
///
/// # Panics
/// If it is not UTF-8.
pub fn quoted(path: &Path) -> String {
    format!("'{}'", path.to_str().expect("a path in text").replace('\'', r"'\''"))
}
