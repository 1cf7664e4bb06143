//! The refusal of what would not fit on the disk or into a quota.

use crate::http::app::App;
use crate::problem::{Kind, Problem};
use crate::storage::fits;

/// Refuses work whose results of about so many bytes in all would not fit.
///
/// # Errors
/// `insufficient-storage` with `needed_bytes` and `free_bytes`, or the store's.
pub(crate) async fn check_room(app: &App, owner: &str, bytes: u64) -> Result<(), Problem> {
    let room = app.shared.storage.room(owner).await?;
    fits(bytes, room).map_err(|no_room| {
        Problem::new(Kind::InsufficientStorage, no_room.to_string())
            .with(|members| {
                members.facts.needed_bytes = Some(no_room.needed);
                members.facts.free_bytes = Some(no_room.left);
            })
            .with_header("retry-after", "60")
    })
}
