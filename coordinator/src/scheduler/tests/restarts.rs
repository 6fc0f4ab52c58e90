//! The promises about jobs that are done again.

use super::*;

#[test]
fn a_job_done_again_from_any_generation_ends_with_the_same_bits() {
    for from in 0..=3 {
        let mut rig = Rig::new();
        let job = rig.submit("a", 7, 3);
        rig.connect("w", 2);
        rig.work_off();
        let first = rig.stored(&job);
        let again = rig.submit_again(&job, from);
        let record = rig.stored(&again);
        assert_eq!((record.generations_done, record.evaluations), (from, 7 * u64::from(from)));
        assert_eq!(record.restarted_from, Some(Origin { job: job.clone(), generations: from }));
        // In the midst of it, too.
        rig.given.clear();
        rig.restart(|_| 7);
        rig.connect("v", 2);
        rig.work_off();
        let record = rig.stored(&again);
        assert_eq!((record.state, record.result_digest), (JobState::Succeeded, first.result_digest), "from {from}");
        assert_eq!((record.counts, record.best, record.winner), (first.counts, first.best, first.winner));
        let history = |id: &JobId| at_once(rig.store.result(id)).history;
        assert_eq!(history(&again), history(&job));
    }
}

#[test]
fn a_tainted_job_done_again_from_there_has_the_digest_of_an_undisturbed_run() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 5, 3);
    rig.connect("liar", 1);
    let mut lie = None;
    while rig.stored(&job).generations_done < 2 {
        let given = rig.take().unwrap();
        let lies = given.range().round == 1 && lie.is_none();
        let delivery = if lies { given.wrong(0) } else { given.delivery() };
        rig.complete(given.completed(delivery));
        if lies {
            lie = Some(given);
        }
    }
    let lie = lie.unwrap();
    rig.complete(Completed { worker: WorkerId("late".into()), ..lie.completed(lie.delivery()) });
    rig.connect("third", 1);
    let question = rig.take_of("third").unwrap();
    let delivery = question.delivery();
    rig.complete(question.completed(delivery));
    assert_eq!(rig.stored(&job).state, JobState::Tainted);

    let again = rig.submit_again(&job, 1);
    rig.work_off();
    assert_eq!(rig.stored(&again).result_digest, Some(expected_digest("a", 5, 3)));
    assert_eq!(rig.stored(&job).state, JobState::Tainted, "the old one stays as it ended");
}
