//! `evogait restart`: repeats an ended job of a coordinator from one of its generations on.

use crate::arguments::Restart;
use crate::client::Client;
use crate::console;
use crate::error::Error;
use crate::view::{JobView, generations};
use crate::watch::word;
use proto::v1;
use sim_core::base::digest::Digest;
use std::time::{SystemTime, UNIX_EPOCH};

/// Restarts the job. The request id depends on job and generation, so a repeated request has no further effect.
pub async fn run(args: Restart, quiet: bool) -> Result<(), Error> {
    let mut client = Client::connect(&args.job.on).await?;
    let again = args.again.then(|| SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as u64);
    let name = Digest::of("evogait restart request 1", &(&args.job.id, args.from_generation, again));
    let request = v1::RestartJobRequest {
        request_id: name.to_string(),
        id: args.job.id.clone(),
        // The first round is the preparation.
        from_round: args.from_generation.map(|generation| generation.saturating_add(1)),
    };
    let (job, created) = client.restart(request).await?;
    if args.job.json {
        return console::say_json(&JobView::new(&job));
    }
    if !quiet {
        let taken_over = job.restarted_from.as_ref().map_or(0, generations);
        console::note(&match created {
            true => format!(
                "\"{}\" is repeated from generation {taken_over} on: {}",
                job.name,
                match taken_over {
                    0 => "nothing is taken over".to_owned(),
                    n => format!("generations 0 to {} are taken over from {}", n - 1, args.job.id),
                }
            ),
            false => format!(
                "the job was already restarted from there: the state of the new job is {} (`--again` starts another one)",
                word(job.state())
            ),
        });
    }
    console::say(&job.id)
}
