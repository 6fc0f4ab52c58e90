//! Tests of late results of sealed rounds, and of workers that contradict themselves.

use super::*;

/// A job in its fourth round. Its first result was wrong or right; worker "w" delivered all results.
fn job_in_fourth_round(wrong: bool) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 4);
    rig.connect("w", 1);
    let first = rig.take().unwrap();
    if wrong {
        rig.deliver_wrong(&first)
    } else {
        rig.answer(&first)
    };
    rig.work_to(&job, 3);
    (rig, job, first)
}

#[test]
fn late_result_of_long_sealed_round_needs_its_tasks() {
    for restarts in [false, true] {
        let (mut rig, job, first) = job_in_fourth_round(true);
        if restarts {
            rig.given.clear();
            rig.restart();
        }
        let before = rig.stored(&job);
        let same = rig.given_to("late", &first);
        let same = same.completed(same.wrong(0));
        assert_eq!(rig.deliver_once(same), Ok(Verdict::Duplicate), "an equal result needs no tasks");
        let late = rig.given_to("late", &first);
        let late = late.completed(late.delivery());
        assert_eq!(rig.deliver_once(late.clone()), Ok(Verdict::NeedsTasks));
        let foreign = vec![first.assign.tasks[0].iter().map(|byte| byte ^ 1).collect()];
        for tasks in [foreign, [first.assign.tasks.clone(), first.assign.tasks.clone()].concat()] {
            let refused = rig.deliver_once(Completed { tasks, ..late.clone() });
            assert!(matches!(refused, Err(RefusedResult::Tasks { .. })), "{refused:?}");
        }
        assert_eq!(rig.stored(&job), before, "a refused delivery stores nothing");

        assert_eq!(rig.deliver(late.clone()), Ok(Verdict::Conflict));
        let record = rig.stored(&job);
        assert_eq!((record.disputes[0].round, record.disputes[0].ruling), (0, None));
        assert!(
            record.disputes[0].claims[0].source.finder.worker.is_empty(),
            "the worker of the committed result is no longer recorded"
        );
        assert!(rig.waits_for(&job).contains("task 0 of round 0 differ"));
        assert_eq!(rig.deliver(late.clone()), Ok(Verdict::Conflict), "a repeated delivery gets the same verdict");
        assert_eq!(rig.stored(&job).disputes[0].claims.len(), 2);
        rig.connect("third", 1);
        let question = rig.take_of("third").unwrap();
        assert_eq!(question.range(), Range { round: 0, first: 0, count: 1 });
        rig.answer(&question);
        assert_eq!(rig.stored(&job).state, JobState::Tainted);
        let again = rig.submit_again(&job, 3, 4, 0);
        rig.work_off();
        rig.assert_right(&again, 3, 4);
        assert_eq!(rig.deliver(late), Ok(Verdict::Obsolete), "the job has ended");
    }
}

#[test]
fn wrong_late_result_of_long_sealed_round_is_refuted() {
    let (mut rig, job, first) = job_in_fourth_round(false);
    assert_eq!(rig.deliver_wrong(&rig.given_to("faulty", &first)), Verdict::Conflict);
    rig.connect("third", 1);
    rig.work_off();
    assert_eq!(rig.rulings(&job), [Some(Ruling::Upheld)]);
    rig.assert_right(&job, 3, 4);
    assert_eq!(rig.quarantined(), ["faulty"]);
}

#[test]
fn unrecorded_worker_can_repeat_its_sealed_result() {
    let (mut rig, job, first) = job_in_fourth_round(true);
    assert_eq!(rig.answer(&rig.given_to("good", &first)), Verdict::Conflict);
    let ordinary = rig.take_of("w").unwrap();
    rig.answer(&ordinary);
    let question = rig.take_of("w").expect("\"w\" may decide: the worker of the committed result is not recorded");
    assert_eq!(question.range().round, 0);
    rig.deliver_wrong(&question);
    assert_eq!(rig.rulings(&job), [None], "a result without a recorded worker does not vote");
    rig.connect("third", 1);
    let question = rig.take_of("third").unwrap();
    rig.answer(&question);
    assert_eq!(rig.stored(&job).state, JobState::Tainted);
    assert_eq!(rig.quarantined(), ["w"]);
}

#[test]
fn result_of_quarantined_worker_or_ended_job_is_ignored() {
    let (mut rig, job, first) = job_in_fourth_round(true);
    let late = rig.given_to("late", &first);
    let late = late.completed(late.delivery());
    assert_eq!(on_result(&mut rig.scheduler, rig.now, late.clone()), Ok(Verdict::Older));
    let finder = crate::record::Claimant { worker: "late".into(), host: "".into() };
    let source = crate::record::Source { finder, name: "".into() };
    trust::quarantine(&mut rig.scheduler, rig.now, &source, "it is a test");
    rig.commit_and_collect();
    assert_eq!(rig.compare(late.clone()), Ok(Verdict::Quarantined));
    assert_eq!(
        on_result(&mut rig.scheduler, rig.now, late),
        Ok(Verdict::Quarantined),
        "a quarantined worker's result is not compared"
    );
    on_cancel(&mut rig.scheduler, rig.now, &job);
    rig.commit_and_collect();
    let other = rig.given_to("other", &first);
    assert_eq!(rig.compare(other.completed(other.delivery())), Ok(Verdict::Obsolete));
    assert_eq!(rig.rulings(&job), []);
}

#[test]
fn two_results_of_one_task_quarantine_their_worker() {
    for sealed in 0..3 {
        let mut rig = Rig::new();
        let job = rig.submit("a", 3, 4);
        rig.connect("w", 1);
        let first = rig.take().unwrap();
        rig.answer(&first);
        rig.work_to(&job, sealed);
        // The scheduler still has the worker of the committed result.
        if sealed < 2 {
            assert_eq!(rig.deliver_wrong(&first), Verdict::Conflict);
            assert_eq!(rig.quarantined(), ["w"], "sealed since: {sealed}");
        }
        // Worker "x" delivers two results, and neither is the committed one.
        let other = rig.given_to("x", &first);
        assert_eq!(rig.deliver_wrong(&other), Verdict::Conflict);
        assert!(!rig.is_quarantined("x"));
        assert_eq!(rig.deliver_wrong(&other), Verdict::Conflict, "a repeated result gets the same verdict");
        assert!(!rig.is_quarantined("x"));
        assert_eq!(rig.complete(other.completed(other.wrong(1))), Verdict::Conflict);
        assert!(rig.is_quarantined("x"), "sealed since: {sealed}");
        assert_eq!(rig.answer(&other), Verdict::Quarantined);
        rig.given.clear();
        rig.connect("d", 1);
        rig.connect("e", 1);
        rig.work_off();
        if sealed == 2 {
            rig.given.clear();
            rig.restart();
            rig.connect("f", 1);
            rig.connect("g", 1);
            rig.work_off();
        }
        rig.assert_right(&job, 3, 4);
    }
}
