//! Tests of rounds with long tasks, which follow rounds with short ones.

use super::*;

#[test]
fn long_tasks_are_leased_one_per_slot() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 20, 2);
    rig.connect("w", 1);
    let first = rig.work_to_long().unwrap();
    assert_eq!(rig.phase(&job), "finishing");
    rig.connect("v", 3);
    assert_eq!(leased(&rig, &job), 4, "no lease in advance");
    assert_eq!(rig.scheduler.round(&job), Some((0, 8)));
    rig.answer(&first);
    assert_eq!(rig.scheduler.round(&job), Some((1, 8)));
    rig.work_to(&job, 3);
    assert_eq!((rig.phase(&job).as_str(), leased(&rig, &job)), ("reporting", 4));
    rig.work_off();
    rig.assert_right(&job, 20, 2);
    assert_eq!(rig.scheduler.round(&job), None);
}

#[test]
fn measured_cost_holds_within_a_phase() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 20, 2);
    rig.connect("w", 2);
    let cost = |rig: &Rig| rig.scheduler.jobs.active[&job].cost;
    assert_eq!(cost(&rig), None);
    rig.work_to(&job, 1);
    assert!(cost(&rig).is_some(), "the next round is in the same phase");
    let first = rig.work_to_long().unwrap();
    assert_eq!(cost(&rig), None, "the cost of another phase is unknown");
    // A long task that turns out short is not leased in advance either.
    rig.complete(Completed { compute: Duration::from_millis(1), ..first.completed(first.delivery()) });
    assert!(cost(&rig).is_some_and(|cost| cost < 0.01));
    assert_eq!(leased(&rig, &job), 2);
}

#[test]
fn repeated_or_wrong_long_result_gets_its_verdict() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("w", 1);
    let given = rig.work_to_long().unwrap();
    assert_eq!(rig.answer(&given), Verdict::Accepted);
    assert_eq!(rig.answer(&given), Verdict::Duplicate);
    assert_eq!(rig.deliver_wrong(&rig.given_to("x", &given)), Verdict::Conflict);
    rig.connect("third", 1);
    let mut beyond = given.clone();
    beyond.assign.range.first = 99;
    assert_eq!(rig.answer(&rig.given_to("w", &beyond)), Verdict::Unknown);
    rig.work_to(&job, 2);
    // The round is sealed. The verdicts stay the same, also after a restart.
    assert_eq!(rig.answer(&given), Verdict::Duplicate);
    rig.restart();
    assert_eq!(rig.deliver_wrong(&rig.given_to("z", &given)), Verdict::Conflict);
    rig.connect("v", 1);
    rig.given.retain(|g| &*g.worker.0 == "v");
    rig.work_off();
    assert_eq!(rig.answer(&given), Verdict::Obsolete);
    rig.assert_right(&job, 6, 1);
}

#[test]
fn job_resumes_in_mid_round_after_restart() {
    for (name, answered) in [("a", 0), ("a", 3), ("a", 7), ("a", 9), ("bare", 0), ("bare", 2)] {
        let mut rig = Rig::new();
        let job = rig.submit(name, 20, 3);
        rig.connect("w", 1);
        let mut given = rig.work_to_long().unwrap();
        for _ in 0..answered {
            rig.answer(&given);
            given = rig.take().unwrap();
        }
        let (state, round) = (rig.stored(&job), rig.scheduler.round(&job));
        rig.restart();
        assert_eq!((rig.stored(&job), rig.scheduler.round(&job)), (state, round), "{name} {answered}");
        // A task that still runs is not leased again.
        let welcome = rig.greet(Greeting { running: vec![given.claim()], ..greeting("w", 1) });
        assert_eq!((welcome.keep, rig.take().is_none()), (vec![given.id()], true));
        assert_eq!(rig.answer(&given), Verdict::Accepted);
        rig.work_off();
        rig.assert_right(&job, 20, 3);
    }
}

#[test]
fn long_task_that_crashes_all_workers_fails_its_job() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 1);
    for round in 0..MAX_ATTEMPTS {
        assert_ne!(rig.stored(&job).state, JobState::Failed, "attempt {round}");
        let id = format!("w{round}");
        let session = rig.connect(&id, 1);
        loop {
            let given = rig.work_to_long().expect("a long task is assigned");
            if given.range().round == 2 {
                break;
            }
            rig.answer(&given);
        }
        rig.disconnect(&id, session);
        rig.advance(LEASE);
    }
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Failed);
    let why = "task 0 of round 2 failed 3 times";
    assert!(record.reason.contains(why), "{}", record.reason);
}

#[test]
fn failed_procedure_fails_its_job_with_reason() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    rig.connect("w", 2);
    while let Some(given) = rig.take() {
        let failed: Arc<[u8]> = fake::encode(None).into();
        let results = vec![failed; given.range().count as usize];
        rig.complete(given.completed(Delivery::Results(results)));
    }
    let record = rig.stored(&job);
    assert_eq!((record.state, record.rounds_sealed, record.result_digest), (JobState::Failed, 1, None));
    assert_eq!(record.reason, "all 2 tasks of a round failed");
}

#[test]
fn dispute_about_long_task_corrects_or_taints() {
    for sealed in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 6, 1);
        rig.connect("w", 1);
        let given = rig.work_to_long().unwrap();
        rig.deliver_wrong(&given);
        if sealed {
            rig.work_to(&job, 2);
        }
        assert_eq!(rig.answer(&rig.given_to("x", &given)), Verdict::Conflict);
        rig.connect("y", 1);
        rig.work_off();
        match sealed {
            false => rig.assert_right(&job, 6, 1),
            true => assert_eq!(rig.stored(&job).state, JobState::Tainted, "{}", rig.stored(&job).reason),
        }
    }
}

#[test]
fn round_is_not_sealed_while_any_dispute_is_open() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 3);
    rig.connect("w", 1);
    let first = rig.take().unwrap();
    rig.answer(&first);
    rig.work_to(&job, 1);
    // The dispute is about the round before.
    assert_eq!(rig.deliver_wrong(&rig.given_to("x", &first)), Verdict::Conflict);
    rig.work_off();
    assert_eq!(rig.scheduler.round(&job), Some((3, 3)), "all tasks are done");
    assert_eq!((rig.stored(&job).rounds_sealed, rig.rulings(&job)), (1, vec![None]));
    rig.restart();
    assert_eq!(
        (rig.stored(&job).rounds_sealed, rig.scheduler.round(&job)),
        (1, Some((3, 3))),
        "a restart changes nothing"
    );
    rig.connect("third", 1);
    rig.answer(&rig.given[0].clone());
    assert_eq!((rig.stored(&job).rounds_sealed, rig.rulings(&job)), (2, vec![Some(Ruling::Upheld)]));
    rig.given.remove(0);
    rig.work_off();
    rig.assert_right(&job, 3, 3);
}
