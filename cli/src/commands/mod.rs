//! The commands of the program, one file each.

mod bench;
mod cancel;
mod certs;
mod compare;
mod completions;
mod demand;
mod evaluate;
mod fetch;
mod health;
mod list;
mod man;
mod pause;
mod plan;
mod replay;
mod restart;
mod robot;
mod run;
mod scenarios;
mod sequence;
mod show;
mod simulate;
mod source_run;
mod submit;
mod validate;
mod verify;
mod watch;
mod workers;

use crate::arguments::{Command, Resolved};
use crate::error::Error;
use std::time::Duration;
use tokio::runtime;

/// Time limit for the runtime's tasks to end after the command.
const FAREWELL: Duration = Duration::from_secs(2);

/// Runs a command.
pub fn execute(resolved: Resolved) -> Result<(), Error> {
    let quiet = resolved.quiet;
    match resolved.command {
        Command::Run(args) => run::run(args, quiet),
        Command::Plan(args) => plan::run(args, quiet),
        Command::Simulate(args) => simulate::run(args, quiet),
        Command::Submit(args) => submit::run(args, quiet),
        Command::Watch(args) => with_runtime(watch::run(args, quiet)),
        Command::List(args) => with_runtime(list::run(args)),
        Command::Show(args) => with_runtime(show::run(args)),
        Command::Cancel(args) => with_runtime(cancel::run(args, quiet)),
        Command::Pause(args) => with_runtime(pause::run(args, true, quiet)),
        Command::Resume(args) => with_runtime(pause::run(args, false, quiet)),
        Command::Restart(args) => with_runtime(restart::run(args, quiet)),
        Command::Evaluate(args) => evaluate::run(args, quiet),
        Command::Fetch(args) => with_runtime(fetch::run(args, quiet)),
        Command::Workers { on, json } => with_runtime(workers::run(on, json)),
        Command::Demand { on, json } => with_runtime(demand::run(on, json)),
        Command::Health(args) => with_runtime(health::run(args, quiet)),
        Command::Compare(args) => compare::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Verify(args) => verify::run(args, quiet),
        Command::Validate(args) => validate::run(args),
        Command::Bench(what) => bench::run(what, quiet),
        Command::Robot(args) => robot::run(args, quiet),
        Command::Certs(args) => certs::run(args, quiet),
        Command::Sequence(args) => sequence::run(args, quiet),
        Command::Scenarios { show, json } => scenarios::run(show, json),
        Command::Completions(shell) => completions::run(shell),
        Command::Man { out } => man::run(out.as_deref(), quiet),
    }
}

fn with_runtime<T>(work: impl Future<Output = Result<T, Error>>) -> Result<T, Error> {
    let runtime = runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|e| Error::read("the system's event queue".as_ref(), e))?;
    let result = runtime.block_on(work);
    runtime.shutdown_timeout(FAREWELL);
    result
}
