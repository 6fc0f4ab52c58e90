//! `evogait pause` and `evogait resume`: pause a job of a coordinator and continue it.

use crate::arguments::OneJob;
use crate::client::Client;
use crate::console;
use crate::error::Error;
use crate::view::JobView;
use crate::watch::standing;

/// Pauses the job (`paused`) or resumes it. A job that already has this state does not change.
pub async fn run(args: OneJob, paused: bool, quiet: bool) -> Result<(), Error> {
    let mut client = Client::connect(&args.on).await?;
    let job = if paused { client.pause(&args.id).await? } else { client.resume(&args.id).await? };
    if args.json {
        return console::say_json(&JobView::new(&job));
    }
    if quiet {
        return Ok(());
    }
    let (name, id) = (&job.name, &job.id);
    console::say(&if paused {
        format!(
            "\"{name}\" ({id}) is paused: tasks that already run may finish\n  next  evogait resume {}",
            console::quoted(id)
        )
    } else {
        format!("\"{name}\" ({id}) is resumed: {}", standing(&job))
    })
}
