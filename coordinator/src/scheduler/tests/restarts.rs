//! Tests of jobs that repeat an earlier job from one of its rounds.

use super::*;

#[test]
fn restarted_job_from_any_round_has_same_bits() {
    for from in 0..=3 {
        let mut rig = Rig::new();
        let job = rig.submit("a", 7, 3);
        rig.connect("w", 2);
        rig.work_off();
        let first = rig.stored(&job);
        assert_eq!((first.rounds_kept, first.rounds_sealed), (3, 5));
        let again = rig.submit_again(&job, 7, 3, from);
        let record = rig.stored(&again);
        assert_eq!((record.rounds_sealed, record.rounds_kept), (from, from));
        assert_eq!(record.progress.done, from);
        assert_eq!(record.restarted_from, Some(Origin { job: job.clone(), rounds: from }));
        // The coordinator restarts in the middle of the new job.
        rig.given.clear();
        rig.restart();
        rig.connect("v", 2);
        rig.work_off();
        let record = rig.stored(&again);
        assert_eq!((record.state, record.result_digest), (JobState::Succeeded, first.result_digest), "from {from}");
        assert_eq!((record.progress, record.rounds_kept), (first.progress, first.rounds_kept));
        assert_eq!(at_once(rig.store.result(&again)), at_once(rig.store.result(&job)));
    }
}

#[test]
fn round_that_was_not_kept_is_not_taken_over() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 7, 3);
    rig.connect("w", 2);
    rig.work_off();
    let mut fake = Fake::new(7, 3);
    let mut carried = Carried::start(Origin { job: job.clone(), rounds: 4 }, &rig.stored(&job).job_digest);
    let rounds = at_once(rig.store.rounds(&job, 0, 10));
    assert_eq!(rounds.len(), 5);
    let mut foreign = rounds[0].clone();
    foreign.number = 1;
    assert!(carried.clone().tell(&mut fake.clone(), foreign).is_err());
    for sealed in &rounds[..3] {
        carried.tell(&mut fake, sealed.clone()).unwrap();
    }
    let refused = carried.tell(&mut fake, rounds[3].clone()).unwrap_err();
    assert!(refused.to_string().contains("its results are not kept"), "{refused}");
}

#[test]
fn late_result_of_carried_round_is_compared() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 2);
    rig.connect("w", 1);
    rig.work_off();
    let again = rig.submit_again(&job, 3, 2, 1);
    assert_eq!(rig.deliver_tasks("late", &again, 0..1, false), Verdict::Duplicate);
    assert_eq!(rig.deliver_tasks("faulty", &again, 0..1, true), Verdict::Conflict);
    assert_eq!(rig.rulings(&again), [None]);
    rig.connect("third", 1);
    rig.work_off();
    assert_eq!(rig.quarantined(), ["faulty"]);
    rig.assert_right(&again, 3, 2);
}

#[test]
fn restarted_tainted_job_has_undisturbed_digest() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 5, 3);
    rig.connect("faulty", 1);
    rig.work_to(&job, 1);
    let wrong = rig.take().unwrap();
    rig.deliver_wrong(&wrong);
    rig.work_to(&job, 2);
    rig.answer(&rig.given_to("late", &wrong));
    rig.connect("third", 1);
    let question = rig.take_of("third").unwrap();
    rig.answer(&question);
    assert_eq!(rig.stored(&job).state, JobState::Tainted);

    let again = rig.submit_again(&job, 5, 3, 1);
    rig.work_off();
    rig.assert_right(&again, 5, 3);
    assert_eq!(rig.stored(&job).state, JobState::Tainted, "the earlier job stays tainted");
}
