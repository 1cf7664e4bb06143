//! The store is moved, removed or replaced while the service runs, or does not answer: nothing is accepted or answered
//! that is not of the store, and the service says why and ends, or is not ready until the store is back.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::harness::deadline::{eventually, patiently, within};
use crate::harness::{
    Client, DataDir, Launch, Postgres, Server, holds_every_store, id_of, jobs, machine, packstone, run,
};

/// A fault by its name, the file that it concerns, and what makes it in a data directory.
type Fault = (&'static str, &'static str, fn(&Path));

/// The service ends by itself so long after its store was replaced: a look, and the end of a run.
const ENDS_WITHIN: Duration = Duration::from_secs(20);
/// Exit code of a fault of the machine.
const MACHINE: i32 = 6;

/// The service answers nothing from then on, says why, and ends.
async fn refuses_and_ends(server: Server, what: &str) {
    let client = server.client();
    client.post("/v1/jobs").json(&jobs::quick(2)).send().await.expect_problem(503, "not-ready");
    client.get("/v1/jobs").send().await.expect_problem(503, "not-ready");
    client.get("/readyz").send().await.expect_problem(503, "not-ready");
    client.get("/healthz").send().await.expect_problem(503, "not-ready");
    eventually("the words in the log", || server.log().contains("the store is gone; the service ends")).await;
    assert!(server.log().contains(what), "{}", server.log());
    let status = server.ends_within(ENDS_WITHIN).await;
    assert_eq!(status.code(), Some(MACHINE), "{what}");
}

/// A copy of a file in its place, with the same bytes.
fn replace(file: &Path) {
    let copy = file.with_extension("copy");
    fs::copy(file, &copy).unwrap();
    fs::rename(&copy, file).unwrap();
}

#[tokio::test]
async fn a_store_that_is_moved_removed_or_replaced_accepts_and_answers_nothing() {
    if holds_every_store() {
        return;
    }
    let away = |path: &Path| path.with_extension("away");
    let changes: [Fault; 7] = [
        ("the data directory is moved", "", |data| fs::rename(data, data.with_extension("away")).unwrap()),
        ("the data directory is removed", "", |data| fs::remove_dir_all(data).unwrap()),
        ("the database is replaced by a copy", "packstone.sqlite", |data| {
            replace(&data.join("packstone.sqlite"));
        }),
        ("the database is removed", "packstone.sqlite", |data| {
            fs::remove_file(data.join("packstone.sqlite")).unwrap();
        }),
        ("the log is removed", "packstone.sqlite-wal", |data| {
            fs::remove_file(data.join("packstone.sqlite-wal")).unwrap();
        }),
        ("the shared memory is removed", "packstone.sqlite-shm", |data| {
            fs::remove_file(data.join("packstone.sqlite-shm")).unwrap();
        }),
        ("another directory takes its place", "", |data| {
            fs::rename(data, data.with_extension("away")).unwrap();
            fs::create_dir(data).unwrap();
        }),
    ];
    for (name, file, change) in changes {
        let data_dir = DataDir::new();
        let server = Server::start(&data_dir).await;
        let client = server.client();
        let before = client.succeed(&jobs::quick(1)).await;
        change(data_dir.path());
        refuses_and_ends(server, &data_dir.path().join(file).display().to_string()).await;
        // What was accepted is where the data went.
        if away(data_dir.path()).exists() {
            let _ = fs::remove_dir_all(data_dir.path());
            fs::rename(away(data_dir.path()), data_dir.path()).unwrap();
            let server = Server::start(&data_dir).await;
            assert_eq!(server.client().job(id_of(&before)).await["state"], "succeeded", "{name}");
            server.stop().await;
        }
    }
}

/// Overwrites the database through the interface of SQLite, as `.restore` does.
async fn restore(python: &Path, database: &Path, backup: &Path) {
    let script = "import sqlite3, sys; sqlite3.connect(sys.argv[1]).backup(sqlite3.connect(sys.argv[2]))";
    let mut command = Command::new(python);
    command.args(["-c", script]).args([backup, database]);
    let restored = run(command).await;
    assert_eq!(restored.code, Some(0), "{restored:?}");
}

#[tokio::test]
async fn a_database_that_is_overwritten_in_place_accepts_and_answers_nothing() {
    if holds_every_store() {
        return;
    }
    let through_sqlite = machine::python("No database was restored through SQLite.");
    let ways = [None].into_iter().chain(through_sqlite.map(Some));
    for (python, of_this_run) in ways.flat_map(|python| [(python.clone(), false), (python, true)]) {
        let data_dir = DataDir::new();
        let backup = data_dir.path().with_extension("backup");
        let paths = [backup.to_str().unwrap(), "--data-dir", data_dir.path().to_str().unwrap()];
        let server = Server::start(&data_dir).await;
        server.client().succeed(&jobs::quick(1)).await;
        let made = packstone(data_dir.path(), &[&["backup"][..], &paths].concat()).await;
        assert_eq!(made.code, Some(0), "{made:?}");
        let server = if of_this_run {
            server
        } else {
            server.stop().await;
            Server::start(&data_dir).await
        };
        server.client().succeed(&jobs::quick(2)).await;
        let (database, backup) = (data_dir.path().join("packstone.sqlite"), backup.join("packstone.sqlite"));
        if let Some(python) = &python {
            restore(python, &database, &backup).await;
        } else {
            // As `cp` does.
            fs::write(database, fs::read(backup).unwrap()).unwrap();
        }
        refuses_and_ends(server, "another one than at the start").await;
    }
}

#[tokio::test]
async fn a_link_to_another_data_directory_is_another_store() {
    if holds_every_store() {
        return;
    }
    let (data_dir, other) = (DataDir::new(), tempfile::tempdir().unwrap());
    let real = other.path().join("real");
    fs::create_dir(&real).unwrap();
    fs::create_dir_all(data_dir.path().parent().unwrap()).unwrap();
    symlink(&real, data_dir.path()).unwrap();
    let server = Server::start(&data_dir).await;
    server.client().succeed(&jobs::quick(1)).await;
    fs::remove_file(data_dir.path()).unwrap();
    fs::create_dir(other.path().join("second")).unwrap();
    symlink(other.path().join("second"), data_dir.path()).unwrap();
    refuses_and_ends(server, "was moved, removed or replaced").await;
}

#[tokio::test]
async fn a_service_whose_lock_or_folder_is_moved_ends() {
    if holds_every_store() {
        return;
    }
    for moved in ["lock", "checkpoints", "artifacts"] {
        let data_dir = DataDir::new();
        let server = Server::start(&data_dir).await;
        let job = server.client().succeed(&jobs::quick(1)).await;
        fs::rename(data_dir.path().join(moved), data_dir.path().join("away")).unwrap();
        if moved == "artifacts" {
            // Before a look has found it: the result is out of reach, and not damaged.
            let result = format!("/v1/jobs/{}/result?format=csv", id_of(&job));
            server.client().get(&result).send().await.expect_problem(503, "not-ready");
        }
        eventually("the words in the log", || server.log().contains("the store is gone; the service ends"))
            .await;
        assert!(server.log().contains(&format!("/{moved} was moved")), "{}", server.log());
        assert_eq!(server.ends_within(ENDS_WITHIN).await.code(), Some(MACHINE), "{moved}");
        assert!(!data_dir.path().join(moved).exists(), "{moved} is not made again");
    }
}

async fn on_postgres(postgres: &Postgres, data_dir: &DataDir) -> (Server, Client) {
    let launch = Launch::new(data_dir).args(&["--store", &postgres.database("lab"), "--lease-s", "3"]);
    let server = launch.start().await;
    let client = server.client();
    client.succeed(&jobs::quick(1)).await;
    (server, client)
}

#[tokio::test]
async fn a_database_of_postgresql_that_is_made_again_or_restored_ends_the_service() {
    let Some(postgres) = Postgres::start() else { return };
    for (name, database, statements) in [
        ("recreated", "postgres", &["drop database lab with (force)", "create database lab"][..]),
        ("dropped", "postgres", &["drop database lab with (force)"]),
        // As a failover to another server would.
        ("of another identity", "lab", &["update packstone set id = 'other'"]),
        // The same rows in tables that were made again, as by the restoration of a dump.
        (
            "restored",
            "lab",
            &["alter table packstone rename to before", "create table packstone as select * from before"],
        ),
    ] {
        let data_dir = DataDir::new();
        let (server, _) = on_postgres(&postgres, &data_dir).await;
        for statement in statements {
            postgres.ask(database, statement);
        }
        eventually("the words in the log", || server.log().contains("the store is gone; the service ends"))
            .await;
        assert!(server.log().contains("another one than at the start"), "{name}: {}", server.log());
        assert_eq!(server.ends_within(ENDS_WITHIN).await.code(), Some(MACHINE), "{name}");
        postgres.ask("postgres", "drop database if exists lab with (force)");
    }
}

#[tokio::test]
async fn a_cluster_that_is_put_back_to_an_earlier_state_ends_the_service() {
    let Some(postgres) = Postgres::start() else { return };
    let data_dir = DataDir::new();
    let (server, client) = on_postgres(&postgres, &data_dir).await;
    let ready = async || {
        let ready = async {
            while client.get("/readyz").send().await.status.as_u16() != 200 {
                tokio::task::yield_now().await;
            }
        };
        patiently("the service to be ready", ready).await;
    };
    postgres.crash();
    let earlier = postgres.copied();
    postgres.up();
    ready().await;
    // A crash alone loses nothing, and is no earlier state.
    client.succeed(&jobs::quick(2)).await;
    postgres.crash();
    postgres.up();
    ready().await;
    client.succeed(&jobs::quick(3)).await;
    postgres.crash();
    postgres.put_back(&earlier);
    postgres.up();
    eventually("the words in the log", || server.log().contains("the store is gone; the service ends")).await;
    assert!(server.log().contains("another one than at the start"), "{}", server.log());
    assert_eq!(server.ends_within(ENDS_WITHIN).await.code(), Some(MACHINE));
}

#[tokio::test]
async fn a_database_that_does_not_answer_is_not_waited_for() {
    let Some(postgres) = Postgres::start() else { return };
    let data_dir = DataDir::new();
    let (server, client) = on_postgres(&postgres, &data_dir).await;
    let suspended = postgres.suspend();
    let refused = async {
        loop {
            let reply = client.get("/v1/jobs").timeout(Duration::from_mins(1)).send().await;
            if reply.status.as_u16() == 503 {
                return reply;
            }
        }
    };
    // The request that met the silence itself is answered too.
    within(Duration::from_secs(50), "an answer", refused).await.expect_problem(503, "not-ready");
    client.post("/v1/jobs").json(&jobs::quick(2)).send().await.expect_problem(503, "not-ready");
    client.get("/readyz").send().await.expect_problem(503, "not-ready");
    drop(suspended);
    let back = async {
        while client.get("/readyz").send().await.status.as_u16() != 200 {
            tokio::task::yield_now().await;
        }
    };
    patiently("the service to be ready", back).await;
    client.succeed(&jobs::quick(3)).await;
    server.stop().await;
}
