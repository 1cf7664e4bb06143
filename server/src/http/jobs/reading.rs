//! Reading the body of a job, for a submission or a plan.

use bytes::Bytes;
use jiff::Timestamp;
use packstone_engine::{Limits, Plan};

use crate::failure::Failure;
use crate::http::app::{App, LARGE_BODY_BYTES};
use crate::http::submission::{content_sha256, read_apart};
use crate::http::webhooks;
use crate::jobs::{JobRequest, request};
use crate::problem::Problem;
use crate::strict_json;

/// A job that was read and planned.
pub(crate) struct Submission {
    pub(crate) request: JobRequest,
    pub(crate) plan: Plan,
    pub(crate) body_sha256: String,
}

/// Whether a plan proposes what else the specimen could hold, which takes a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Proposal {
    Made,
    None,
}

/// Reads and plans a submission. Large ones are put aside, so that they do not hold up answers to
/// others, and few at a time.
pub(crate) async fn read(
    app: &App,
    bytes: Bytes,
    limits: Limits,
    proposal: Proposal,
) -> Result<Submission, Problem> {
    let submission = if bytes.len() <= LARGE_BODY_BYTES {
        read_now(&bytes, &limits, proposal)?
    } else {
        read_apart(app, move |_| read_now(&bytes, &limits, proposal)).await?
    };
    webhooks::check(&app.shared.webhook_rules, submission.request.webhook_url.as_ref())?;
    Ok(submission)
}

fn read_now(bytes: &[u8], limits: &Limits, proposal: Proposal) -> Result<Submission, Failure> {
    let value = strict_json::parse(bytes)?;
    let request =
        JobRequest::read(&value, request::draw_seed(), Some(Timestamp::now())).map_err(Failure::invalid)?;
    let packing = request.packing();
    let mut plan = Plan::new(&packing, limits)?;
    request.check_postprocess(limits)?;
    if proposal == Proposal::Made {
        plan = plan.with_proposal(&packing);
    }
    Ok(Submission { request, plan, body_sha256: content_sha256(value) })
}
