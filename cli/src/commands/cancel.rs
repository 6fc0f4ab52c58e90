//! `evogait cancel`: cancels a job of a coordinator permanently.

use crate::arguments::OneJob;
use crate::client::Client;
use crate::console;
use crate::error::Error;
use crate::view::JobView;
use crate::watch::word;
use proto::v1::JobState;

/// Cancels the job. A job that had already ended does not change, and the output reports that.
pub async fn run(args: OneJob, quiet: bool) -> Result<(), Error> {
    let mut client = Client::connect(&args.on).await?;
    let job = client.cancel(&args.id).await?;
    if args.json {
        return console::say_json(&JobView::new(&job));
    }
    if quiet {
        return Ok(());
    }
    console::say(&match job.state() {
        JobState::Cancelled => format!("\"{}\" ({}) is cancelled", job.name, job.id),
        state => format!("\"{}\" ({}) had already ended: its state is {}", job.name, job.id, word(state)),
    })
}
