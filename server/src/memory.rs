//! Memory of the machine, of the control group that this process runs in, or of its own address space (`ulimit -v`),
//! whichever is least.
//!
//! Containers limit memory by Linux control groups: version 2 writes the limit to `memory.max`, version 1 to
//! `memory.limit_in_bytes`, each for a group and all groups above it
//! (<https://docs.kernel.org/admin-guide/cgroup-v2.html>, "Memory Interface Files").
//!
//! Memory that was freed is returned to the system from time to time, where the binary names a function that does so.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use rustix::process::{Resource, getrlimit};
use tokio_util::sync::CancellationToken;

use crate::tasks;

/// Time between two looks at the memory of the process.
const LOOK_EVERY: Duration = Duration::from_secs(10);
/// Growth since the start that is worth a release, which reads all free blocks.
const LEAST_GROWTH_BYTES: u64 = 4 << 20;

static RELEASE: OnceLock<fn()> = OnceLock::new();

/// Sets the function that returns free memory to the system; the first one stays.
pub(crate) fn set_release(release: fn()) {
    let _ = RELEASE.set(release);
}

/// Returns free memory to the system from time to time while the process is larger than at its start, until `shutdown`.
///
/// What is freed by the end of a job was in use at an earlier release, and frees no page by itself: so the size after
/// the last release does not tell whether another one is worth it.
pub(crate) async fn release_regularly(shutdown: CancellationToken) {
    let Some(release) = RELEASE.get() else { return };
    let at_start = resident_bytes().unwrap_or_default();
    while shutdown.run_until_cancelled(tokio::time::sleep(LOOK_EVERY)).await.is_some() {
        if resident_bytes().is_some_and(|bytes| bytes >= at_start + LEAST_GROWTH_BYTES)
            && tasks::blocking(release).await.is_err()
        {
            return;
        }
    }
}

/// Bytes of memory that this process has now (`/proc/self/statm`, second field, in pages).
fn resident_bytes() -> Option<u64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: u64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * rustix::param::page_size() as u64)
}

/// Bytes of memory that this process may use; `None` where the system does not say.
pub(crate) fn total_bytes() -> Option<u64> {
    let address_space = getrlimit(Resource::As).current;
    total_bytes_by(&|path| std::fs::read_to_string(path).ok()).into_iter().chain(address_space).min()
}

/// The same with the files as `read` gives them.
fn total_bytes_by(read: &dyn Fn(&Path) -> Option<String>) -> Option<u64> {
    let machine = read(Path::new("/proc/meminfo")).and_then(|text| machine_bytes(&text));
    let groups = read(Path::new("/proc/self/cgroup")).unwrap_or_default();
    let limits = limit_files(&groups).into_iter().filter_map(|file| limit_bytes(&read(&file)?));
    limits.chain(machine).min()
}

fn machine_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The files that may hold a limit, by the text of `/proc/self/cgroup`: of the group, of those above it, and of the
/// root of the mount, which inside a container is the container's own group.
fn limit_files(groups: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(group)) = (parts.next(), parts.next(), parts.next()) else {
            continue;
        };
        let (mount, file) = if controllers.is_empty() {
            ("/sys/fs/cgroup", "memory.max")
        } else if controllers.split(',').any(|name| name == "memory") {
            ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
        } else {
            continue;
        };
        let below = Path::new(group.trim_start_matches('/'));
        files.extend(below.ancestors().map(|group| Path::new(mount).join(group).join(file)));
    }
    files
}

/// The limit in such a file; `None` for `max`. Version 1 writes a number near 2^63 where there is none, which is more
/// than any machine has.
fn limit_bytes(text: &str) -> Option<u64> {
    text.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;

    fn total(files: &[(&str, &str)]) -> Option<u64> {
        let files: HashMap<&str, &str> = files.iter().copied().collect();
        total_bytes_by(&|path| files.get(path.to_str()?).map(|text| (*text).to_owned()))
    }

    const MACHINE: (&str, &str) = ("/proc/meminfo", "MemFree: 1 kB\nMemTotal:       4096 kB\n");

    #[test]
    fn without_a_group_it_is_the_machines() {
        assert_eq!(total(&[MACHINE]), Some(4 << 20));
        assert_eq!(total(&[("/proc/meminfo", "MemFree: 1 kB\n")]), None);
    }

    #[test]
    fn version_2_is_read_up_to_the_root() {
        let group = ("/proc/self/cgroup", "0::/a/b\n");
        assert_eq!(total(&[MACHINE, group, ("/sys/fs/cgroup/a/b/memory.max", "1048576\n")]), Some(1 << 20));
        assert_eq!(
            total(&[
                MACHINE,
                group,
                ("/sys/fs/cgroup/a/b/memory.max", "max\n"),
                ("/sys/fs/cgroup/a/memory.max", "2097152\n")
            ]),
            Some(2 << 20)
        );
        // In a container the group's path is that of the host, and its limit stands at the root of the mount.
        assert_eq!(total(&[MACHINE, group, ("/sys/fs/cgroup/memory.max", "65536\n")]), Some(65536));
        assert_eq!(total(&[MACHINE, group, ("/sys/fs/cgroup/a/b/memory.max", "max\n")]), Some(4 << 20));
    }

    #[test]
    fn version_1_is_read_too() {
        let group = ("/proc/self/cgroup", "12:cpu,cpuacct:/x\n4:memory:/docker/1\n0::/\n");
        let limit = |text| ("/sys/fs/cgroup/memory/docker/1/memory.limit_in_bytes", text);
        assert_eq!(total(&[MACHINE, group, limit("1048576\n")]), Some(1 << 20));
        assert_eq!(total(&[MACHINE, group, limit("9223372036854771712\n")]), Some(4 << 20));
    }

    proptest! {
        #[test]
        fn it_is_never_more_than_any_limit(limits in proptest::collection::vec(0_u64..1 << 40, 1..4)) {
            let group = "g/".repeat(limits.len());
            let mut files = vec![
                ("/proc/meminfo".to_owned(), "MemTotal: 1000000000 kB".to_owned()),
                ("/proc/self/cgroup".to_owned(), format!("0::/{}", group.trim_end_matches('/'))),
            ];
            for (depth, limit) in limits.iter().enumerate() {
                let folder = "g/".repeat(depth + 1);
                files.push((format!("/sys/fs/cgroup/{folder}memory.max"), limit.to_string()));
            }
            let files: Vec<_> = files.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
            prop_assert_eq!(total(&files), limits.iter().copied().min().map(|least| least.min(1_024_000_000_000)));
        }

        #[test]
        fn no_text_is_fatal(groups in ".*", meminfo in ".*", limit in ".*") {
            let _ = total(&[
                ("/proc/meminfo", &meminfo), ("/proc/self/cgroup", &groups), ("/sys/fs/cgroup/memory.max", &limit),
            ]);
        }
    }
}
