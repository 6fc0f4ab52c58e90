//! The promises about what a worker found that turned out to compute wrongly.

use super::*;
use crate::record::Ruling;

/// A worker's answer about candidates of generation 0, asked or not; `wrong` of one that computes wrongly.
fn says(rig: &mut Rig, who: &str, job: &JobId, tasks: std::ops::Range<u32>, wrong: bool) -> Verdict {
    let population = rig.stored(job).population;
    let range = Range { round: 0, first: tasks.start, count: tasks.len() as u32 };
    let task = Task::Evaluate { range, genomes: Fake::new(population).ask().into(), base: 0 };
    let given = Given { worker: WorkerId(who.into()), assignment: AssignmentId(0), job: job.clone(), task };
    let delivery = if wrong { given.wrong(0) } else { given.delivery() };
    rig.complete(given.completed(delivery))
}

/// Two others show that a worker got candidate `index` wrong.
fn is_found_wrong(rig: &mut Rig, who: &str, job: &JobId, index: u32) {
    for honest in ["b", "c"] {
        says(rig, honest, job, index..index + 1, false);
    }
    assert!(rig.scheduler.quarantined.contains_key(&WorkerId(who.into())), "{who} stands alone");
}

fn rulings(rig: &Rig, job: &JobId) -> Vec<(u32, Option<Ruling>)> {
    rig.stored(job).disputes.iter().map(|d| (d.index, d.ruling)).collect()
}

#[test]
fn a_message_of_wrong_results_does_no_harm_though_only_one_of_them_was_found_twice() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 11, 2);
    assert_eq!(says(&mut rig, "bad", &job, 0..10, true), Verdict::Accepted);
    is_found_wrong(&mut rig, "bad", &job, 0);
    assert_eq!(rig.stored(&job).disputes.len(), 10, "all that it found is in doubt");
    // The rest of the round changes nothing about that.
    assert_eq!(says(&mut rig, "b", &job, 10..11, false), Verdict::Accepted);
    assert_eq!(rig.stored(&job).generations_done, 0, "nothing is sealed before it is decided");
    let why = rig.scheduler.waits_for(&job).unwrap();
    let told = "waits for another worker: 9 tasks were found by a worker that computes wrongly, candidate 1 of generation 0 \
                for one";
    assert!(why.contains(told), "{why}");
    rig.restart(|_| 11);
    assert_eq!(rig.stored(&job).disputes.len(), 10, "a restart changes nothing");
    rig.connect("d", 1);
    rig.work_off();
    let why = rig.scheduler.waits_for(&job).unwrap();
    assert!(why.contains("results of 9 tasks differ"), "{why}");
    rig.connect("e", 1);
    rig.work_off();
    let record = rig.stored(&job);
    assert_eq!((record.state, record.result_digest), (JobState::Succeeded, Some(expected_digest("a", 11, 2))));
    assert_eq!(rig.scheduler.quarantined.len(), 1, "whoever confirms nothing is not to blame");
}

#[test]
fn one_answer_that_agrees_clears_what_was_in_doubt() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 2);
    says(&mut rig, "bad", &job, 0..4, false);
    says(&mut rig, "bad", &job, 4..5, true);
    is_found_wrong(&mut rig, "bad", &job, 4);
    says(&mut rig, "d", &job, 0..4, false);
    let upheld: Vec<_> = (0..4).map(|index| (index, Some(Ruling::Upheld))).collect();
    assert_eq!(rulings(&rig, &job), [vec![(4, Some(Ruling::Corrected))], upheld].concat());
    assert_eq!(says(&mut rig, "d", &job, 5..6, false), Verdict::Accepted);
    assert_eq!(rig.stored(&job).generations_done, 1);
    rig.connect("d", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 6, 2)));
}

#[test]
fn what_it_found_for_other_jobs_is_asked_again_with_one_write_each() {
    for lied in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 6, 2);
        let (sealed, untouched) = (rig.submit("b", 5, 3), rig.submit("c", 5, 3));
        says(&mut rig, "bad", &sealed, 0..5, lied);
        says(&mut rig, "b", &untouched, 0..4, false);
        assert_eq!(rig.stored(&sealed).generations_done, 1);
        says(&mut rig, "bad", &job, 0..5, true);
        says(&mut rig, "b", &job, 0..1, false);

        let range = Range { round: 0, first: 0, count: 1 };
        let task = Task::Evaluate { range, genomes: Fake::new(6).ask().into(), base: 0 };
        let worker = WorkerId("c".into());
        let given = Given { worker, assignment: AssignmentId(0), job: job.clone(), task };
        rig.scheduler.complete(rig.now, given.completed(given.delivery()));
        let noted = rig.scheduler.to_note.iter().map(|id| (id.clone(), rig.scheduler.jobs[id].record.disputes.len()));
        assert_eq!(noted.collect::<Vec<_>>(), [(job.clone(), 5), (sealed.clone(), 5)], "one write a job");
        rig.settle();

        rig.connect("d", 1);
        rig.connect("e", 1);
        rig.work_off();
        assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 6, 2)));
        assert_eq!(rig.stored(&untouched).result_digest, Some(expected_digest("c", 5, 3)));
        let record = rig.stored(&sealed);
        if lied {
            assert_eq!(record.state, JobState::Tainted, "what was sealed does not change");
            assert!(record.reason.contains("of generation 0 that was sealed in round 0 is wrong"), "{}", record.reason);
        } else {
            assert_eq!(record.result_digest, Some(expected_digest("b", 5, 3)));
        }
    }
}

#[test]
fn answers_about_the_archive_come_into_doubt_too() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("bad", 1);
    let first = rig.work_to_finish().unwrap();
    rig.complete(first.completed(first.wrong(0)));
    let second = rig.take_of("bad").unwrap();
    assert!(second.question().is_some());
    rig.complete(second.completed(second.wrong(0)));
    for honest in ["b", "c"] {
        rig.complete(Completed { worker: WorkerId(honest.into()), ..first.completed(first.delivery()) });
    }
    let record = rig.stored(&job);
    let doubted: Vec<_> = record.disputes.iter().filter(|d| d.ruling.is_none()).map(|d| (d.round, d.index)).collect();
    let mut generation: Vec<_> = (0..6).map(|index| (0, index)).collect();
    generation.push((second.range().round, second.range().first));
    assert_eq!(doubted, generation, "the answer, and the generation sealed last");
    rig.given.clear();
    rig.connect("d", 1);
    rig.connect("e", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 6, 1)));
}

#[test]
fn two_that_compute_wrongly_do_not_clear_each_other() {
    for sealed in [true, false] {
        let mut rig = Rig::new();
        let (job, other) = (rig.submit("a", 5, 2), rig.submit("b", 3, 1));
        says(&mut rig, "bad", &job, 1..3, true);
        says(&mut rig, "bad", &other, 0..1, true);
        says(&mut rig, "worse", &other, 1..2, true);
        is_found_wrong(&mut rig, "bad", &other, 0);
        says(&mut rig, "worse", &job, 1..3, true);
        assert_eq!(rulings(&rig, &job), [(1, Some(Ruling::Upheld)), (2, Some(Ruling::Upheld))]);
        says(&mut rig, "b", &job, 0..1, false);
        says(&mut rig, "b", &job, 3..if sealed { 5 } else { 4 }, false);
        assert_eq!(rig.stored(&job).generations_done, u32::from(sealed));
        is_found_wrong(&mut rig, "worse", &other, 1);
        assert_eq!(rulings(&rig, &job), [(1, None), (2, None)], "open again");
        rig.restart(|id| if *id == job { 5 } else { 3 });
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
fn what_was_corrected_by_two_that_compute_wrongly_is_corrected_again() {
    let mut rig = Rig::new();
    let (job, other) = (rig.submit("a", 4, 2), rig.submit("b", 3, 1));
    says(&mut rig, "a", &job, 0..1, false);
    for bad in ["bad", "worse"] {
        says(&mut rig, bad, &job, 0..1, true);
    }
    assert_eq!(rulings(&rig, &job), [(0, Some(Ruling::Corrected))], "two against one");
    says(&mut rig, "bad", &other, 0..1, true);
    says(&mut rig, "worse", &other, 1..2, true);
    is_found_wrong(&mut rig, "bad", &other, 0);
    assert_eq!(rulings(&rig, &job), [(0, Some(Ruling::Corrected))], "one of them is still trusted");
    is_found_wrong(&mut rig, "worse", &other, 1);
    assert_eq!(rulings(&rig, &job), [(0, None)]);
    rig.connect("d", 1);
    let question = rig.take_of("d").unwrap();
    assert_eq!((question.job.clone(), question.range().first), (job.clone(), 0));
    rig.complete(question.completed(question.delivery()));
    rig.given.clear();
    rig.restart(|id| if *id == job { 4 } else { 3 });
    rig.connect("d", 1);
    rig.connect("e", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 4, 2)));
}

#[test]
fn thousands_in_doubt_cost_an_event_nothing_while_nobody_is_free() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3000, 1);
    let session = rig.connect("d", 1);
    says(&mut rig, "bad", &job, 1000..2999, true);
    is_found_wrong(&mut rig, "bad", &job, 1000);
    assert_eq!(rig.stored(&job).disputes.len(), 1999);
    assert!(rig.scheduler.workers[&WorkerId("d".into())].held.len() == 1, "it is busy");
    let before = rig.scheduler.room.steps;
    rig.heartbeat("d", session, 1);
    assert!(rig.scheduler.room.steps - before < 10);
    // All of them are handed out in ranges as soon as somebody is.
    rig.work_off();
    rig.connect("e", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 3000, 1)));
}
