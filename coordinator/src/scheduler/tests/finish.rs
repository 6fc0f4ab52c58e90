//! The promises of the rounds that follow the search.

use super::*;

#[test]
fn the_published_winner_is_the_archives_best_on_the_reference() {
    let mut rig = Rig::new();
    let (job, bare) = (rig.submit("a", 20, 3), rig.submit("bare", 20, 3));
    rig.connect("w", 3);
    rig.work_off();

    let (record, report) = (rig.stored(&job), rig.report(&job));
    assert_eq!(record.best.as_ref(), Some(&report.best));
    let reference = |s: &Scored| sim_core::base::score::mean(&answer(&Examination::new(Question::Reference, s)).scores);
    let means: Vec<_> = report.archive.iter().map(|a| reference(&a.candidate)).collect();
    assert_eq!(means.len(), 4);
    assert!(means.is_sorted_by(|a, b| !Direction::Maximise.better(*b, *a)), "ranked: {means:?}");
    assert_eq!(report.winner, report.archive[0].candidate);
    assert_eq!(record.winner.as_ref(), Some(&report.winner));
    assert_eq!(report.archive[0].reference, report.winner_scores.reference);
    assert!(!report.first_scores.reference.is_empty() && report.first_scores.less_friction.is_empty());
    assert!(!report.winner_scores.less_friction.is_empty() && !report.winner_scores.without_reuse.is_empty());

    // Every new global best is audited, in the order in which they came.
    let history = at_once(rig.store.result(&job)).history;
    let mut bests: Vec<f64> = history.iter().filter_map(|g| g.best_so_far).collect();
    bests.dedup();
    assert_eq!(report.audits.iter().map(|a| a.candidate.score).collect::<Vec<_>>(), bests);
    for audit in &report.audits {
        let examination = Examination::new(Question::WithoutReuse, &audit.candidate);
        assert_eq!(audit.without_reuse, answer(&examination).scores);
    }

    let (record, report) = (rig.stored(&bare), rig.report(&bare));
    assert_eq!((record.winner.as_ref(), &report.winner), (record.best.as_ref(), &report.best));
    assert!(report.archive.is_empty() && report.audits.is_empty() && report.winner_scores.reference.is_empty());
    assert_eq!(report.winner_scores.fresh.len(), 3);
}

#[test]
fn examinations_are_shared_by_all_slots_and_told_as_progress() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 20, 2);
    rig.connect("w", 1);
    let first = rig.work_to_finish().unwrap();
    assert_eq!(rig.stored(&job).state, JobState::Finishing);
    rig.connect("v", 3);
    assert_eq!(leased(&rig, &job), 4, "one examination a slot, none in advance");
    let (done, total) = rig.scheduler.round(&job).unwrap();
    let audits = rig.scheduler.jobs[&job].round.size() - 4;
    assert_eq!((done, total), (0, audits + 4));
    let delivery = first.delivery();
    rig.complete(first.completed(delivery));
    assert_eq!(rig.scheduler.round(&job), Some((1, total)));
    while rig.stored(&job).state == JobState::Finishing {
        let given = rig.take().unwrap();
        let delivery = given.delivery();
        rig.complete(given.completed(delivery));
    }
    assert_eq!(rig.stored(&job).state, JobState::Reporting);
    assert_eq!(leased(&rig, &job), 4);
    rig.work_off();
    assert_eq!(rig.stored(&job).state, JobState::Succeeded);
    assert_eq!(rig.scheduler.round(&job), None);
}

#[test]
fn a_repeated_or_wrong_answer_is_told_as_such_as_long_as_the_job_runs() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("w", 1);
    let given = rig.work_to_finish().unwrap();
    let right = given.delivery();
    let Delivery::Examination { round, index, outcome } = right.clone() else { panic!("an examination") };
    let mut outcome = outcome;
    outcome.scores[1] = outcome.scores[1].map_or(Some(1.0), |s| Some(-s));
    let wrong = Delivery::Examination { round, index, outcome: outcome.clone() };
    assert_eq!(rig.complete(given.completed(right.clone())), Verdict::Accepted);
    assert_eq!(rig.complete(given.completed(right.clone())), Verdict::Duplicate);
    let by = |who: &str, delivery| Completed { worker: WorkerId(who.into()), ..given.completed(delivery) };
    assert_eq!(rig.complete(by("x", wrong.clone())), Verdict::Conflict);
    rig.connect("third", 1);
    let beyond = Delivery::Examination { round, index: 99, outcome: outcome.clone() };
    assert_eq!(rig.complete(given.completed(beyond)), Verdict::Unknown);
    let as_scores = Delivery::Evaluations { generation: round, first: index, outcomes: vec![outcome] };
    assert_eq!(rig.complete(given.completed(as_scores)), Verdict::Unknown, "a round is no generation");
    while rig.stored(&job).state == JobState::Finishing {
        let given = rig.take().unwrap();
        let delivery = given.delivery();
        rig.complete(given.completed(delivery));
    }
    // The round is sealed: the same answers still, after a restart too.
    assert_eq!(rig.complete(given.completed(right.clone())), Verdict::Duplicate);
    rig.restart(|_| 6);
    assert_eq!(rig.complete(by("z", wrong)), Verdict::Conflict);
    rig.connect("v", 1);
    rig.given.retain(|g| g.worker.to_string() == "v");
    rig.work_off();
    assert_eq!(rig.complete(given.completed(right)), Verdict::Obsolete);
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 6, 1)));
}

#[test]
fn after_a_restart_the_finish_goes_on_where_it_was() {
    for (name, answered) in [("a", 0), ("a", 3), ("a", 7), ("a", 9), ("bare", 0), ("bare", 2)] {
        let mut rig = Rig::new();
        let job = rig.submit(name, 20, 3);
        rig.connect("w", 1);
        let mut given = rig.work_to_finish().unwrap();
        for _ in 0..answered {
            let delivery = given.delivery();
            rig.complete(given.completed(delivery));
            given = rig.take().unwrap();
        }
        let (state, round) = (rig.stored(&job).state, rig.scheduler.round(&job));
        rig.restart(|_| 20);
        assert_eq!((rig.stored(&job).state, rig.scheduler.round(&job)), (state, round), "{name} {answered}");
        // Work that still runs is not done twice.
        let claim = (given.assignment, given.job.clone(), given.range());
        let welcome = rig.scheduler.connect(rig.now, Greeting { running: vec![claim], ..greeting("w", 1) });
        rig.settle();
        assert_eq!((welcome.keep, rig.take().is_none()), (vec![given.assignment], true));
        let delivery = given.delivery();
        assert_eq!(rig.complete(given.completed(delivery)), Verdict::Accepted);
        rig.work_off();
        assert_eq!(rig.stored(&job).result_digest, Some(expected_digest(name, 20, 3)), "{name} {answered}");
    }
}

#[test]
fn an_examination_that_crashes_every_worker_fails_the_job_and_says_which_it_was() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 1);
    for round in 0..MAX_ATTEMPTS {
        assert_ne!(rig.stored(&job).state, JobState::Failed, "attempt {round}");
        let id = format!("w{round}");
        let session = rig.connect(&id, 1);
        loop {
            let given = rig.work_to_finish().expect("the finish");
            if given.question() == Some(Question::Traces) {
                break;
            }
            let delivery = given.delivery();
            rig.complete(given.completed(delivery));
        }
        rig.scheduler.disconnect(rig.now, &WorkerId(id.as_str().into()), session);
        rig.advance(LEASE);
    }
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Failed);
    let winner = record.winner.unwrap();
    let who = format!("the traces of candidate {} of generation {}", winner.candidate, winner.generation);
    assert!(record.reason.contains(&who) && record.reason.contains("failed 3 times"), "{}", record.reason);
}

#[test]
fn traces_that_are_none_fail_the_job_instead_of_the_coordinator() {
    let mut rig = Rig::new();
    let job = rig.submit("bare", 2, 1);
    rig.connect("w", 1);
    let mut next = rig.work_to_finish();
    while let Some(given) = next {
        let Delivery::Examination { round, index, outcome } = given.delivery() else { panic!("an examination") };
        let outcome = Outcome { traces: Vec::new(), ..outcome };
        rig.complete(given.completed(Delivery::Examination { round, index, outcome }));
        next = rig.take();
    }
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Failed);
    assert!(record.reason.contains("the report can't be put together"), "{}", record.reason);
}
