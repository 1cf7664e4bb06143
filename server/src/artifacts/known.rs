//! What is known of the blocks of files since the start of the server.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::blobs::blocks::BlockSums;

/// Most sums that are kept, of 64 GiB of files; beyond, they are forgotten, and made again of files whose SHA-256 is
/// compared again.
const MOST_SUMS: usize = 2 << 20;
/// What keeping a file costs besides its sums, counted in sums.
const SUMS_PER_FILE: usize = 32;

/// The sums of the blocks of files by their paths. Clones share them.
#[derive(Clone, Debug, Default)]
pub(super) struct Known(Arc<Mutex<Files>>);

#[derive(Debug, Default)]
struct Files {
    sums: HashMap<String, Arc<BlockSums>>,
    kept: usize,
}

impl Known {
    /// The sums of a file, where they are known.
    pub(super) fn get(&self, path: &str) -> Option<Arc<BlockSums>> {
        self.files().sums.get(path).cloned()
    }

    /// Keeps the sums of a file.
    pub(super) fn keep(&self, path: &str, sums: &Arc<BlockSums>) {
        let mut files = self.files();
        files.forget(path);
        let more = cost(sums);
        if files.kept + more > MOST_SUMS {
            *files = Files::default();
        }
        files.kept += more;
        files.sums.insert(path.to_owned(), Arc::clone(sums));
    }

    /// Forgets the sums of a file.
    pub(super) fn forget(&self, path: &str) {
        self.files().forget(path);
    }

    /// One who panicked cannot have left it half-changed.
    fn files(&self) -> MutexGuard<'_, Files> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Files {
    fn forget(&mut self, path: &str) {
        if let Some(sums) = self.sums.remove(path) {
            self.kept -= cost(&sums);
        }
    }
}

fn cost(sums: &BlockSums) -> usize {
    sums.len() + SUMS_PER_FILE
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::blobs::blocks::BlockSummer;

    #[test]
    fn sums_are_bounded() {
        let known = Known::default();
        let mut summer = BlockSummer::default();
        summer.update(&[0; 100]);
        let sums = Arc::new(summer.finish());
        let most = MOST_SUMS / cost(&sums);
        for file in 0..most {
            known.keep(&file.to_string(), &sums);
        }
        // One that is known already costs nothing more.
        known.keep("0", &sums);
        assert!(known.get("0").is_some() && known.get(&(most - 1).to_string()).is_some());
        known.keep("another", &sums);
        assert!(known.get("0").is_none() && known.get("another").is_some());
        known.forget("another");
        known.forget("another");
        assert_eq!(known.files().kept, 0);
    }
}
