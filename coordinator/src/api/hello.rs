//! Checks of a worker's Hello.

use super::{at_most, id, printable};
use crate::convert;
use crate::limits::MAX_RUNNING;
use crate::scheduler::{Greeting, WorkerId};
use proto::limits::{MAX_ENGINES, MAX_ID, MAX_SLOTS, MAX_TIME, MAX_WORKER_NAME};
use proto::{PROTOCOL, v1};
use sim_core::base::digest::Digest;
use std::sync::Arc;
use std::time::Duration;
use tonic::Status;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Engines of a build, by name.
type Engines = [(&'static str, Digest)];

/// Checks the fields of a worker's Hello. Its engines are checked separately, see [`is_of_build`].
pub(crate) fn check(hello: v1::Hello, address: String, credential: Arc<str>) -> Result<Greeting, Status> {
    at_most("version", &hello.version, MAX_WORKER_NAME)?;
    printable("version", &hello.version)?;
    if hello.protocol != PROTOCOL {
        return Err(Status::failed_precondition(format!(
            "the worker (evogait {}) uses protocol {} and this coordinator (evogait {VERSION}) uses protocol {PROTOCOL}: \
             run the same version on both",
            hello.version, hello.protocol
        )));
    }
    id("worker_id", &hello.worker_id)?;
    printable("worker_id", &hello.worker_id)?;
    at_most("name", &hello.name, MAX_WORKER_NAME)?;
    printable("name", &hello.name)?;
    if !(1..=MAX_SLOTS).contains(&hello.slots) {
        return Err(Status::failed_precondition(format!(
            "slots = {} is out of range: 1 to {MAX_SLOTS} are allowed",
            hello.slots
        )));
    }
    if hello.engine_digests.len() > MAX_ENGINES {
        return Err(Status::failed_precondition(format!(
            "the worker offers {} engines: at most {MAX_ENGINES} are allowed",
            hello.engine_digests.len()
        )));
    }
    let offered = hello
        .engine_digests
        .iter()
        .map(|bytes| proto::digest("engine_digests", bytes))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|e| Status::failed_precondition(e.to_string()))?;
    if hello.running.len() > MAX_RUNNING {
        return Err(Status::failed_precondition(format!(
            "the worker reports {} running assignments: at most {MAX_RUNNING} are allowed",
            hello.running.len()
        )));
    }
    let running =
        hello.running.into_iter().filter(|running| running.job_id.len() <= MAX_ID).map(convert::running).collect();
    let time_left = time("seconds_left", Duration::from_secs(hello.seconds_left))?;
    let stuck_after = time("stuck_after_ms", Duration::from_millis(hello.stuck_after_ms))?;
    Ok(Greeting {
        worker: WorkerId(hello.worker_id.into()),
        name: hello.name,
        version: hello.version,
        address,
        credential,
        slots: hello.slots,
        engines: offered,
        running,
        time_left,
        stuck_after,
    })
}

/// Checks a duration that a worker reports; zero means unknown and returns `None`.
fn time(field: &str, given: Duration) -> Result<Option<Duration>, Status> {
    if given > MAX_TIME {
        let (given, most) = (given.as_secs(), MAX_TIME.as_secs());
        return Err(Status::failed_precondition(format!("{field} is {given} s: at most {most} s are allowed")));
    }
    Ok((given > Duration::ZERO).then_some(given))
}

/// Returns true if the worker has an engine of this build.
pub(crate) fn is_of_build(greeting: &Greeting, engines: &Engines) -> bool {
    greeting.engines.iter().any(|digest| engines.iter().any(|(_, own)| own == digest))
}

/// Returns the error for a worker without an engine of this build. It applies if no active job needs its engines.
pub(crate) fn other_build(greeting: &Greeting, engines: &Engines) -> Status {
    let theirs = greeting.engines.iter().map(Digest::short).collect::<Vec<_>>().join(", ");
    let ours = engines.iter().map(|(name, d)| format!("{name} {}", d.short())).collect::<Vec<_>>().join(", ");
    Status::failed_precondition(format!(
        "the worker's engines ({theirs}; evogait {}) compute other bits than the coordinator's ({ours}; evogait {VERSION}), \
         and no active job needs them: run the same build on both",
        greeting.version
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hello() -> v1::Hello {
        v1::Hello {
            protocol: PROTOCOL,
            worker_id: "w".to_owned(),
            name: "n".to_owned(),
            slots: 1,
            engine_digests: vec![vec![7; 32]],
            running: Vec::new(),
            version: "9.9.9".to_owned(),
            seconds_left: 0,
            stuck_after_ms: 0,
        }
    }

    #[test]
    fn errors_name_worker_and_coordinator() {
        let engines = [("rapier", Digest([7; 32]))];
        let refused = |hello| check(hello, String::new(), Arc::default()).unwrap_err().message().to_owned();
        assert!(is_of_build(&check(hello(), String::new(), Arc::default()).unwrap(), &engines));

        let message = refused(v1::Hello { protocol: PROTOCOL + 1, ..hello() });
        assert!(message.contains("evogait 9.9.9") && message.contains(VERSION), "{message}");
        let (theirs, ours) = (format!("protocol {}", PROTOCOL + 1), format!("protocol {PROTOCOL}"));
        assert!(message.contains(&theirs) && message.contains(&ours), "{message}");

        let other =
            check(v1::Hello { engine_digests: vec![vec![8; 32]], ..hello() }, String::new(), Arc::default()).unwrap();
        assert!(!is_of_build(&other, &engines));
        let message = other_build(&other, &engines).message().to_owned();
        assert!(message.contains("080808080808; evogait 9.9.9"), "{message}");
        assert!(message.contains("rapier 070707070707") && message.contains(VERSION), "{message}");

        assert!(refused(v1::Hello { engine_digests: vec![vec![8; 3]], ..hello() }).contains("3 bytes"));
        assert!(refused(v1::Hello { slots: 0, ..hello() }).contains("slots = 0"));
        for seconds_left in [MAX_TIME.as_secs() + 1, u64::MAX] {
            assert!(refused(v1::Hello { seconds_left, ..hello() }).contains("at most 31622400 s"));
        }
        assert!(refused(v1::Hello { stuck_after_ms: u64::MAX, ..hello() }).contains("stuck_after_ms is"));
        let running = vec![v1::RunningAssignment::default(); MAX_RUNNING + 1];
        assert!(refused(v1::Hello { running, ..hello() }).contains(&format!("at most {MAX_RUNNING}")));
        let red = "\u{1b}[31mred".to_owned();
        assert!(refused(v1::Hello { name: red.clone(), ..hello() }).contains("name has a control character, \\u{1b}"));
        assert!(refused(v1::Hello { version: red.clone(), ..hello() }).contains("version has a control"));
        assert!(refused(v1::Hello { worker_id: red, ..hello() }).contains("worker_id has a control"));
        assert!(refused(v1::Hello { worker_id: String::new(), ..hello() }).contains("worker_id is missing"));
        assert!(refused(v1::Hello { worker_id: "w".repeat(65), ..hello() }).contains("at most 64"));
    }
}
