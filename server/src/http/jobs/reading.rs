//! Reading and planning the body of a job, for a submission or a plan.

use std::sync::Arc;

use bytes::Bytes;
use jiff::Timestamp;
use packstone_engine::{Limits, PackingRequest, Plan};

use crate::exports::estimates::{PlannedExport, planned};
use crate::failure::Failure;
use crate::http::app::{App, LARGE_BODY_BYTES, SMALL_BODY_BYTES, Shared};
use crate::http::submission::{content_sha256, read_apart};
use crate::http::webhooks;
use crate::jobs::{JobRequest, request};
use crate::planning::{Planner, Proposal};
use crate::problem::Problem;
use crate::strict_json;

/// A job that was read and planned.
pub(crate) struct Submission {
    pub(crate) request: JobRequest,
    pub(crate) plan: Plan,
    /// The exports that `postprocess` names.
    pub(crate) exports: Vec<PlannedExport>,
    pub(crate) body_sha256: String,
}

/// A job that was read.
struct Draft {
    request: JobRequest,
    packing: PackingRequest,
    body_sha256: String,
}

/// Reads and plans a submission. What takes more than a millisecond is computed off the threads that answer: bodies
/// that are not small among the documents, which are soon done; large ones, grains of other shapes than spheres,
/// proposals and exports among the plans.
pub(crate) async fn read(
    app: &App,
    bytes: Bytes,
    limits: Limits,
    proposal: Proposal,
) -> Result<Submission, Problem> {
    let shared = Arc::clone(&app.shared);
    let submission = if bytes.len() > LARGE_BODY_BYTES {
        read_apart(app, move |_| Draft::read(&bytes)?.plan(&shared.planner, &limits, proposal)).await?
    } else {
        let is_small = bytes.len() <= SMALL_BODY_BYTES;
        let begin = move |shared: &Shared| begin(&bytes, &shared.planner, &limits, proposal);
        let begun = if is_small {
            begin(&shared)?
        } else {
            let shared = Arc::clone(&shared);
            app.shared.documents.run(move |_| begin(&shared)).await??
        };
        match begun {
            Begun::Planned(submission) => *submission,
            Begun::Read(draft) => {
                app.shared.compute.run(move |_| draft.plan(&shared.planner, &limits, proposal)).await??
            }
        }
    };
    webhooks::check(&app.shared.webhook_rules, submission.request.webhook_url.as_ref())?;
    Ok(submission)
}

/// A submission whose plan takes a while, or the whole of another.
enum Begun {
    Read(Box<Draft>),
    Planned(Box<Submission>),
}

fn begin(bytes: &[u8], planner: &Planner, limits: &Limits, proposal: Proposal) -> Result<Begun, Failure> {
    let draft = Draft::read(bytes)?;
    if draft.takes_a_moment(planner, limits, proposal) {
        draft.plan(planner, limits, proposal).map(|submission| Begun::Planned(Box::new(submission)))
    } else {
        Ok(Begun::Read(Box::new(draft)))
    }
}

impl Draft {
    fn read(bytes: &[u8]) -> Result<Self, Failure> {
        let value = strict_json::parse(bytes)?;
        let request = JobRequest::read(&value, request::draw_seed(), Some(Timestamp::now()))
            .map_err(Failure::invalid)?;
        Ok(Self { packing: request.packing(), request, body_sha256: content_sha256(value) })
    }

    /// Whether its plan takes no longer than reading it.
    fn takes_a_moment(&self, planner: &Planner, limits: &Limits, proposal: Proposal) -> bool {
        let is_simple = !self.packing.mix.has_shapes() && proposal == Proposal::None;
        self.request.exports().next().is_none()
            && (is_simple || planner.has_plan(&self.packing, limits, proposal))
    }

    fn plan(self, planner: &Planner, limits: &Limits, proposal: Proposal) -> Result<Submission, Failure> {
        let Self { request, packing, body_sha256 } = self;
        let plan = planner.plan(&packing, limits, proposal)?;
        request.check_postprocess(limits)?;
        let has_exports = request.exports().next().is_some();
        let exports = if has_exports {
            planned(request.exports(), &planner.with_templates(&packing), &plan)
        } else {
            Vec::new()
        };
        Ok(Submission { request, plan, exports, body_sha256 })
    }
}
