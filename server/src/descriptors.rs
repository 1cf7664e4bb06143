//! File descriptors: the soft limit of this process is raised, and connections are bounded by what there is.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Descriptors besides those of connections: the database, results being written and sent, logs and libraries.
const OTHERS: u64 = 64;
/// Fewer connections are of no use.
const LEAST_CONNECTIONS: u64 = 16;

/// Too few file descriptors are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "at most {limit} files may be open (ulimit -n), and {needed} are needed at least: raise the limit, or lower \
     --max-downloads or --workers"
)]
pub(crate) struct TooFew {
    limit: u64,
    needed: u64,
}

/// Raises the soft limit to the hard one where that is needed, and returns how many connections may be open: as many as
/// wanted, or as the limit leaves beside `files` other files.
///
/// # Errors
/// [`TooFew`] where hardly any connection could be open.
pub(crate) fn provide(connections: usize, files: usize) -> Result<usize, TooFew> {
    let needed = connections as u64 + files as u64 + OTHERS;
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let limit = match current {
        Some(current) if current < needed => {
            let raised = maximum.map_or(needed, |maximum| maximum.min(needed));
            match setrlimit(Resource::Nofile, Rlimit { current: Some(raised), maximum }) {
                Ok(()) => raised,
                Err(_) => current,
            }
        }
        Some(current) => current,
        None => u64::MAX,
    };
    let allowed = connections_within(limit, connections, files)?;
    if allowed < connections {
        tracing::warn!(
            limit,
            max_connections = allowed,
            wanted = connections,
            "too few files may be open (ulimit -n)"
        );
    }
    Ok(allowed)
}

fn connections_within(limit: u64, connections: usize, files: usize) -> Result<usize, TooFew> {
    let left = limit.saturating_sub(files as u64 + OTHERS);
    let least = LEAST_CONNECTIONS.min(connections as u64);
    if left < least {
        return Err(TooFew { limit, needed: least + files as u64 + OTHERS });
    }
    Ok(connections.min(usize::try_from(left).unwrap_or(usize::MAX)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_are_bounded_by_the_limit() {
        assert_eq!(connections_within(u64::MAX, 1024, 80), Ok(1024));
        assert_eq!(connections_within(1024, 1024, 80), Ok(880));
        assert_eq!(connections_within(100, 1024, 80), Err(TooFew { limit: 100, needed: 160 }));
        assert_eq!(connections_within(150, 4, 80), Ok(4));
    }
}
