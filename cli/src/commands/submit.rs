//! `evogait submit`: submits a job to a coordinator.

use crate::arguments::Submit;
use crate::client::Client;
use crate::error::Error;
use crate::view::JobView;
use crate::{console, load};
use proto::v1;
use sim_core::base::digest::Digest;
use std::time::{SystemTime, UNIX_EPOCH};

/// Submits the job. The request id is the job's digest, so a repeated request has no further effect.
pub fn run(args: Submit, quiet: bool) -> Result<(), Error> {
    let job = load::checked(&args.file)?;
    let digest = job.digest();
    let request = v1::SubmitJobRequest {
        request_id: if args.again { another_id(&digest) } else { digest.to_string() },
        job_toml: job.to_toml(),
        priority: args.priority,
    };
    super::with_runtime(async {
        let mut client = Client::connect(&args.on).await?;
        let (status, created) = client.submit(request).await?;
        if args.json {
            return console::say_json(&JobView::new(&status));
        }
        if !quiet && !created {
            console::note(&format!(
                "the coordinator already has this job: its state is {} (`--again` starts it again)",
                crate::watch::word(status.state())
            ));
        }
        console::say(&status.id)
    })
}

/// Returns a request id that the coordinator does not have yet: the current time makes it unique.
fn another_id(digest: &Digest) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    format!("{}-{}", digest.short(), now.as_nanos())
}
