//! Tests of jobs that were submitted to another build: they wait for its workers.

use super::*;

/// Engine of an older build.
const OLD: Digest = Digest([7; 32]);

/// A coordinator of a new build with two jobs: one submitted to an older build, and one to this build.
fn upgraded() -> (Rig, JobId, JobId) {
    let mut rig = Rig::new();
    let old = on_submit(&mut rig.scheduler, rig.now, NewJob { engine_digest: OLD, ..new_job("a", 20, 2) }).id;
    let own = rig.submit("b", 6, 1);
    rig.scheduler.engines = Arc::new([("own", ENGINE)]);
    (rig, old, own)
}

fn old_worker(id: &str) -> Greeting {
    Greeting { engines: vec![OLD], version: "0.0.1".to_owned(), ..greeting(id, 2) }
}

/// Delivers the right results of all assignments, with each job's own engine.
fn work_off(rig: &mut Rig, old: &JobId) {
    while let Some(given) = rig.take() {
        let engine = if *given.job() == *old { OLD } else { ENGINE };
        let completed = Completed { engine, ..given.completed(given.delivery()) };
        assert_eq!(rig.complete(completed), Verdict::Accepted);
    }
}

#[test]
fn job_of_other_build_waits_for_its_workers() {
    let (mut rig, old, own) = upgraded();
    let said = |rig: &Rig| waits_for(&rig.scheduler, &old).expect("the job waits");
    let version = rig.stored(&old).version;
    assert!(!version.is_empty());
    let told = |said: &str| said.contains(&OLD.short()) && said.contains(&format!("evogait {version}"));
    assert!(told(&said(&rig)) && said(&rig).contains("none is connected"), "{}", said(&rig));
    assert_eq!(rig.waits_for(&own), "waits for a worker: none is connected");
    assert!(
        rig.scheduler.needs(&[ENGINE, OLD]) && rig.scheduler.needs(&[OLD]) && !rig.scheduler.needs(&[Digest([9; 32])])
    );
    assert_eq!(demand(&rig.scheduler).wanted, 6, "workers of this build can't run the old job");

    rig.connect("new", 2);
    assert!(rig.given.iter().all(|g| *g.job() == own), "the new worker gets no task of the old job");
    work_off(&mut rig, &old);
    assert_eq!(rig.stored(&own).state, JobState::Succeeded, "the job of this build runs meanwhile");
    let said = said(&rig);
    assert!(told(&said) && said.contains("none of those connected has it"), "{said}");
    assert!(said.contains(&format!("evogait 0.9.9 with {}", ENGINE.short())), "{said}");
    assert_eq!(rig.stored(&old).state, JobState::Queued);
    let claimed = rig.early("new", &old, 0..1);
    let refused = rig.deliver(claimed.completed(claimed.delivery()));
    assert!(matches!(refused, Err(RefusedResult::Engine { .. })), "{refused:?}");
    let welcome = rig.greet(Greeting { running: vec![claimed.claim()], ..greeting("new", 2) });
    assert_eq!(welcome.keep, [], "a worker of this build can't keep a lease of the old job");

    rig.greet(old_worker("old"));
    assert!(rig.given.iter().all(|g| *g.job() == old && &*g.worker.0 == "old") && !rig.given.is_empty());
    assert_eq!(demand(&rig.scheduler).wanted, 20, "a worker of the old build is connected");
    work_off(&mut rig, &old);
    rig.assert_right(&old, 20, 2);
    assert!(!rig.scheduler.needs(&[OLD]), "an ended job needs no engine");
}
