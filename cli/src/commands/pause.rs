//! `evogait pause` and `evogait resume`: a job of a coordinator rests for a while.

use crate::arguments::OneJob;
use crate::client::Client;
use crate::console;
use crate::error::Error;
use crate::view::JobView;
use crate::watch::standing;

/// Pauses (`true`) or resumes. What was so already stays so.
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
        format!("\"{name}\" ({id}) is paused: what runs may finish\n  next  evogait resume {}", console::quoted(id))
    } else {
        format!("\"{name}\" ({id}) goes on, it is {}", standing(&job))
    })
}
