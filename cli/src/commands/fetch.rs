//! `evogait fetch`: writes the result of a coordinator's job to a folder.

use crate::arguments::Fetch;
use crate::client::Client;
use crate::error::Error;
use crate::output::{self, Folder};
use crate::{console, summary, watch};
use sim_core::problem::Checked;

/// Writes the result of the job. Fails with the reason if there is none.
pub async fn run(args: Fetch, quiet: bool) -> Result<(), Error> {
    let mut client = Client::connect(&args.on).await?;
    let (status, _) = client.get(&args.id).await?;
    watch::succeeded(&status)?;
    let answer = client.result(&args.id).await?;
    let job = Checked::from_toml(&answer.job_toml)
        .map_err(|source| Error::Invalid { file: format!("the job of {}", args.on), source })?;
    let digest = job.digest();
    let path = args.out.unwrap_or_else(|| Folder::default_path(&job.spec().name, &digest));
    let folder = Folder::open(&path, &digest)?;
    let result = output::write(&folder, &job, &answer, &args.on)?;
    if args.json {
        console::say_json(&result)
    } else if quiet {
        Ok(())
    } else {
        console::say(&summary::text(&result, &path))
    }
}
