//! Tests of the other results of a worker after one was shown to be wrong.

use super::*;

/// Two other workers contradict a worker's result of task `index` in round 0.
fn contradict(rig: &mut Rig, worker: &str, job: &JobId, index: u32) {
    for correct in ["b", "c"] {
        rig.deliver_tasks(correct, job, index..index + 1, false);
    }
    assert!(rig.is_quarantined(worker), "{worker} is quarantined");
}

fn rulings(rig: &Rig, job: &JobId) -> Vec<(u32, Option<Ruling>)> {
    rig.stored(job).disputes.iter().map(|d| (d.index, d.ruling)).collect()
}

#[test]
fn wrong_results_are_recomputed_after_one_is_refuted() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 11, 2);
    assert_eq!(rig.deliver_tasks("bad", &job, 0..10, true), Verdict::Accepted);
    contradict(&mut rig, "bad", &job, 0);
    assert_eq!(rig.stored(&job).disputes.len(), 10, "all of its results are disputed");
    // Completing the round does not change that.
    assert_eq!(rig.deliver_tasks("b", &job, 10..11, false), Verdict::Accepted);
    assert_eq!(rig.stored(&job).rounds_sealed, 0, "a round with an open dispute is not sealed");
    let why = rig.waits_for(&job);
    let told = "waits for another worker: only a quarantined worker computed 9 tasks, such as task 1 of round 0";
    assert!(why.contains(told), "{why}");
    rig.restart();
    assert_eq!(rig.stored(&job).disputes.len(), 10, "the disputes survive a restart");
    rig.connect("d", 1);
    rig.work_off();
    let why = rig.waits_for(&job);
    assert!(why.contains("results of 9 tasks differ"), "{why}");
    rig.connect("e", 1);
    rig.work_off();
    let record = rig.stored(&job);
    assert_eq!((record.state, record.result_digest), (JobState::Succeeded, Some(expected_digest("a", 11, 2))));
    assert_eq!(rig.quarantined().len(), 1, "only \"bad\" is quarantined");
}

#[test]
fn one_agreeing_result_upholds_disputed_result() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 2);
    rig.deliver_tasks("bad", &job, 0..4, false);
    rig.deliver_tasks("bad", &job, 4..5, true);
    contradict(&mut rig, "bad", &job, 4);
    rig.deliver_tasks("d", &job, 0..4, false);
    let upheld: Vec<_> = (0..4).map(|index| (index, Some(Ruling::Upheld))).collect();
    assert_eq!(rulings(&rig, &job), [vec![(4, Some(Ruling::Corrected))], upheld].concat());
    assert_eq!(rig.deliver_tasks("d", &job, 5..6, false), Verdict::Accepted);
    assert_eq!(rig.stored(&job).rounds_sealed, 1);
    rig.connect("d", 1);
    rig.work_off();
    rig.assert_right(&job, 6, 2);
}

#[test]
fn disputes_in_other_jobs_need_one_write_each() {
    for wrong in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 6, 2);
        let (sealed, untouched) = (rig.submit("b", 5, 3), rig.submit("c", 5, 3));
        rig.deliver_tasks("bad", &sealed, 0..5, wrong);
        rig.deliver_tasks("b", &untouched, 0..4, false);
        assert_eq!(rig.stored(&sealed).rounds_sealed, 1);
        rig.deliver_tasks("bad", &job, 0..5, true);
        rig.deliver_tasks("b", &job, 0..1, false);

        let given = rig.early("c", &job, 0..1);
        on_result(&mut rig.scheduler, rig.now, given.completed(given.delivery())).unwrap();
        let disputes = |id: &JobId| rig.scheduler.jobs.active[id].record.disputes.len();
        let noted: Vec<_> = rig.scheduler.out.to_note.iter().map(|id| (id.clone(), disputes(id))).collect();
        assert_eq!(noted, [(job.clone(), 5), (sealed.clone(), 5)], "one write per job");
        rig.commit_and_collect();

        rig.connect("d", 1);
        rig.connect("e", 1);
        rig.work_off();
        rig.assert_right(&job, 6, 2);
        rig.assert_right(&untouched, 5, 3);
        let record = rig.stored(&sealed);
        if wrong {
            assert_eq!(record.state, JobState::Tainted, "a wrong sealed result taints the job");
            assert!(record.reason.contains("of round 0 that was sealed in round 0 is wrong"), "{}", record.reason);
        } else {
            assert_eq!(record.result_digest, Some(expected_digest("b", 5, 3)));
        }
    }
}

#[test]
fn results_of_long_tasks_are_disputed() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("bad", 1);
    let first = rig.work_to_long().unwrap();
    rig.deliver_wrong(&first);
    let second = rig.take_of("bad").unwrap();
    assert!(second.is_long());
    rig.deliver_wrong(&second);
    for correct in ["b", "c"] {
        rig.complete(rig.given_to(correct, &first).completed(first.delivery()));
    }
    let record = rig.stored(&job);
    let doubted: Vec<_> = record.disputes.iter().filter(|d| d.ruling.is_none()).map(|d| (d.round, d.index)).collect();
    let mut expected: Vec<_> = (0..6).map(|index| (0, index)).collect();
    expected.push((second.range().round, second.range().first));
    assert_eq!(doubted, expected, "disputed: its results in the current round and in the round sealed last");
    rig.given.clear();
    rig.connect("d", 1);
    rig.connect("e", 1);
    rig.work_off();
    rig.assert_right(&job, 6, 1);
}

#[test]
fn quarantined_workers_do_not_confirm_each_other() {
    for sealed in [true, false] {
        let mut rig = Rig::new();
        let (job, other) = (rig.submit("a", 5, 2), rig.submit("b", 3, 1));
        rig.deliver_tasks("bad", &job, 1..3, true);
        rig.deliver_tasks("bad", &other, 0..1, true);
        rig.deliver_tasks("worse", &other, 1..2, true);
        contradict(&mut rig, "bad", &other, 0);
        rig.deliver_tasks("worse", &job, 1..3, true);
        assert_eq!(rulings(&rig, &job), [(1, Some(Ruling::Upheld)), (2, Some(Ruling::Upheld))]);
        rig.deliver_tasks("b", &job, 0..1, false);
        rig.deliver_tasks("b", &job, 3..if sealed { 5 } else { 4 }, false);
        assert_eq!(rig.stored(&job).rounds_sealed, u32::from(sealed));
        contradict(&mut rig, "worse", &other, 1);
        assert_eq!(rulings(&rig, &job), [(1, None), (2, None)], "the disputes are open again");
        rig.restart();
        rig.connect("d", 1);
        rig.connect("e", 1);
        rig.work_off();
        let record = rig.stored(&job);
        match sealed {
            true => assert_eq!(record.state, JobState::Tainted),
            false => assert_eq!(record.result_digest, Some(expected_digest("a", 5, 2))),
        }
    }
}

#[test]
fn wrong_correction_by_quarantined_workers_is_corrected_again() {
    let mut rig = Rig::new();
    let (job, other) = (rig.submit("a", 4, 2), rig.submit("b", 3, 1));
    rig.deliver_tasks("a", &job, 0..1, false);
    for bad in ["bad", "worse"] {
        rig.deliver_tasks(bad, &job, 0..1, true);
    }
    assert_eq!(rulings(&rig, &job), [(0, Some(Ruling::Corrected))], "two workers against one");
    rig.deliver_tasks("bad", &other, 0..1, true);
    rig.deliver_tasks("worse", &other, 1..2, true);
    contradict(&mut rig, "bad", &other, 0);
    assert_eq!(rulings(&rig, &job), [(0, Some(Ruling::Corrected))], "one of the two workers is still trusted");
    contradict(&mut rig, "worse", &other, 1);
    assert_eq!(rulings(&rig, &job), [(0, None)]);
    rig.connect("d", 1);
    let question = rig.take_of("d").unwrap();
    assert_eq!((question.job().clone(), question.range().first), (job.clone(), 0));
    rig.answer(&question);
    rig.given.clear();
    rig.restart();
    rig.connect("d", 1);
    rig.connect("e", 1);
    rig.work_off();
    rig.assert_right(&job, 4, 2);
}

#[test]
fn disputes_cost_nothing_without_free_slot() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3000, 1);
    let session = rig.connect("d", 1);
    rig.deliver_tasks("bad", &job, 1000..2999, true);
    contradict(&mut rig, "bad", &job, 1000);
    assert_eq!(rig.stored(&job).disputes.len(), 1999);
    assert!(rig.scheduler.fleet.workers[&WorkerId("d".into())].held.len() == 1, "the only worker is busy");
    let before = rig.scheduler.queue.room.steps;
    rig.heartbeat("d", session, 1);
    assert!(rig.scheduler.queue.room.steps - before < 10);
    // All of them are leased in ranges as soon as a slot is free.
    rig.work_off();
    rig.connect("e", 1);
    rig.work_off();
    rig.assert_right(&job, 3000, 1);
}
