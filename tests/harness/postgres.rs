//! A PostgreSQL of its own for tests, from the distribution's package, on a Unix socket in a temporary folder.

use std::io::Write as _;
use std::os::unix::fs::{PermissionsExt as _, chown};
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

/// Set where the tests that need PostgreSQL must not be left out.
const REQUIRED: &str = "PACKSTONE_POSTGRES";
/// URL of a running PostgreSQL, without a database: then every server of the suite has its store there.
const FOR_ALL: &str = "PACKSTONE_TEST_POSTGRES";

/// A running PostgreSQL; dropped, it is stopped and its folder removed.
pub(crate) struct Postgres {
    programs: PathBuf,
    /// The user whom it runs as, where the tests run as root: PostgreSQL refuses that one.
    user: Option<String>,
    folder: TempDir,
}

impl Postgres {
    /// Starts one. `None`, said aloud, where it is not installed.
    pub(crate) fn start() -> Option<Self> {
        let required = std::env::var_os(REQUIRED).is_some_and(|value| !value.is_empty());
        let Some(programs) = programs() else {
            let why = "no PostgreSQL (initdb, pg_ctl); install postgresql (Debian)";
            assert!(!required, "{REQUIRED} is set, but {why}");
            // Past the capture of the test harness: that nothing was tested must be seen.
            let warning = format!("\n*** SKIPPED: nothing was tested with PostgreSQL: {why}\n");
            std::io::stderr().write_all(warning.as_bytes()).unwrap();
            return None;
        };
        let folder = tempfile::tempdir().expect("a temporary directory");
        let user = rustix::process::getuid().is_root().then(|| "postgres".to_owned());
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        let home = folder.path().join("home");
        std::fs::create_dir(&home).unwrap();
        if let Some(user) = &user {
            let (uid, gid) = ids(user);
            chown(&home, Some(uid), Some(gid)).expect("root may do this");
        }
        let postgres = Self { programs, user, folder };
        postgres.run("initdb", &format!("-A trust --no-sync -U packstone -D {}", postgres.data().display()));
        postgres.up();
        Some(postgres)
    }

    /// The URL of a database of that name, which is made where it is missing.
    pub(crate) fn database(&self, name: &str) -> String {
        let url = format!("postgres://packstone@localhost/?host={}", self.home().display());
        database_of(&url, name)
    }

    /// Starts it again after [`Self::crash`].
    pub(crate) fn up(&self) {
        self.up_with("-c listen_addresses=''");
    }

    /// Starts it so that it takes connections over TLS alone, with the certificate of the tests. The URL of a database
    /// without the parameters of TLS.
    pub(crate) fn restarted_with_tls(&self, name: &str) -> String {
        self.database(name);
        self.crash();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let tls = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/tls"));
        let key = self.home().join("key.pem");
        std::fs::copy(tls.join("key.pem"), &key).unwrap();
        std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
        if let Some(user) = &self.user {
            let (uid, gid) = ids(user);
            chown(&key, Some(uid), Some(gid)).expect("root may do this");
        }
        std::fs::copy(tls.join("certificate.pem"), self.home().join("certificate.pem")).unwrap();
        std::fs::write(self.data().join("pg_hba.conf"), "hostssl all all 127.0.0.1/32 trust\n").unwrap();
        let home = self.home().display().to_string();
        self.up_with(&format!(
            "-c listen_addresses=127.0.0.1 -c port={port} -c ssl=on -c ssl_cert_file={home}/certificate.pem \
             -c ssl_key_file={home}/key.pem"
        ));
        format!("postgres://packstone@127.0.0.1:{port}/{name}")
    }

    fn up_with(&self, settings: &str) {
        let (data, home) = (self.data().display().to_string(), self.home().display().to_string());
        let settings = format!("{settings} -c unix_socket_directories={home} -c fsync=off");
        self.run("pg_ctl", &format!("-D {data} -w -l {home}/log -o \"{settings}\" start"));
    }

    /// Ends it without a word, as a crash does.
    pub(crate) fn crash(&self) {
        self.run("pg_ctl", &format!("-D {} -w -m immediate stop", self.data().display()));
    }

    /// A copy of all that it has on the disk, while it does not run.
    pub(crate) fn copied(&self) -> PathBuf {
        let copy = self.home().join("copy");
        self.run("cp", &format!("-a {} {}", self.data().display(), copy.display()));
        copy
    }

    /// Puts such a copy in the place of what it has, while it does not run.
    pub(crate) fn put_back(&self, copy: &Path) {
        let data = self.data();
        self.run("rm", &format!("-rf {}", data.display()));
        self.run("cp", &format!("-a {} {}", copy.display(), data.display()));
    }

    /// Lets no process of it run until what is returned is dropped: connections hang without an error.
    pub(crate) fn suspend(&self) -> Suspended {
        let file = std::fs::read_to_string(self.data().join("postmaster.pid")).expect("a running PostgreSQL");
        let parent = file.lines().next().expect("a number").to_owned();
        let children =
            Command::new("ps").args(["-o", "pid=", "--ppid", &parent]).output().expect("ps starts");
        let mut processes = vec![parent];
        let children = String::from_utf8_lossy(&children.stdout).into_owned();
        processes.extend(children.split_whitespace().map(str::to_owned));
        let suspended = Suspended { processes };
        suspended.signal(Signal::STOP);
        suspended
    }

    /// The answer to a query in a database, fields separated by bars.
    pub(crate) fn ask(&self, name: &str, query: &str) -> String {
        psql(&self.database(name), query).expect("psql answers")
    }

    fn home(&self) -> PathBuf {
        self.folder.path().join("home")
    }

    fn data(&self) -> PathBuf {
        self.home().join("data")
    }

    fn run(&self, program: &str, arguments: &str) {
        let of_postgres = self.programs.join(program);
        let program = if of_postgres.exists() { of_postgres } else { PathBuf::from(program) };
        let line = format!("{} {arguments}", program.display());
        let mut command = Command::new(if self.user.is_some() { "su" } else { "/bin/sh" });
        if let Some(user) = &self.user {
            command.args([user, "-s", "/bin/sh"]);
        }
        command.args(["-c", &line]);
        // A database that goes on running must not keep a pipe of this process open.
        let status = command.current_dir("/").stdout(std::process::Stdio::null()).status().expect("a shell");
        assert!(status.success(), "{line}: {status}");
    }
}

/// Processes that are stopped; dropped, they go on.
pub(crate) struct Suspended {
    processes: Vec<String>,
}

impl Suspended {
    fn signal(&self, signal: Signal) {
        for process in &self.processes {
            let process = process.parse().ok().and_then(Pid::from_raw).expect("the number of a process");
            // One that ended meanwhile needs nothing.
            let _ = kill_process(process, signal);
        }
    }
}

impl Drop for Suspended {
    fn drop(&mut self) {
        self.signal(Signal::CONT);
    }
}

impl Drop for Postgres {
    fn drop(&mut self) {
        if self.data().join("postmaster.pid").exists() {
            self.crash();
        }
    }
}

/// The store of a server on this data directory, where `PACKSTONE_TEST_POSTGRES` asks for PostgreSQL throughout.
pub(super) fn store_of(data_dir: &Path) -> Option<String> {
    let url = std::env::var(FOR_ALL).ok()?;
    let name = data_dir.to_str().expect("a path in UTF-8").replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    Some(database_of(&url, &name[name.len().saturating_sub(60)..].to_lowercase()))
}

/// A database of the PostgreSQL at this URL, made where it is missing.
fn database_of(url: &str, name: &str) -> String {
    let (server, parameters) = url.split_once("/?").expect("a URL as postgres://user@host/?parameters");
    let parameters = format!("?{parameters}");
    let made = psql(&format!("{server}/postgres{parameters}"), &format!("create database \"{name}\""));
    assert!(made.as_ref().err().is_none_or(|error| error.contains("already exists")), "{made:?}");
    format!("{server}/{name}{parameters}")
}

fn psql(url: &str, query: &str) -> Result<String, String> {
    let output =
        Command::new("psql").args(["-X", "-A", "-t", "-c", query, url]).output().expect("psql starts");
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).trim_end().to_owned())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// Where the programs of the newest version are: Debian keeps them out of the path.
fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir("/usr/lib/postgresql").ok().into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = versions.map(|version| version.path().join("bin")).collect();
    folders.sort();
    let path = std::env::var_os("PATH").unwrap_or_default();
    folders
        .into_iter()
        .rev()
        .chain(std::env::split_paths(&path))
        .find(|folder| ["initdb", "pg_ctl"].iter().all(|program| folder.join(program).exists()))
}

/// Number of a user and of their group.
fn ids(user: &str) -> (u32, u32) {
    let users = std::fs::read_to_string("/etc/passwd").expect("a list of users");
    let line =
        users.lines().find(|line| line.starts_with(&format!("{user}:"))).expect("the user of PostgreSQL");
    let mut fields = line.split(':').skip(2).map(|field| field.parse().expect("a number"));
    (fields.next().unwrap(), fields.next().unwrap())
}

/// Whether a test has to be left out, because it is about SQLite or about a data directory that one server owns, and
/// `PACKSTONE_TEST_POSTGRES` puts every store into PostgreSQL.
pub(crate) fn holds_every_store() -> bool {
    std::env::var_os(FOR_ALL).is_some()
}
