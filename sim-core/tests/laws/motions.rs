//! Tests of motions: events, tracks and end phases of chained motions.

use sim_core::model::Phase;
use sim_core::physics::{Change, Event, Motion, TICK, Targets, Track};

/// A motion of two ticks that holds its joint at `angle`, with an end phase that depends on the angle.
fn motion(angle: f64, events: Vec<Event>, tracks: &[(&str, f32)]) -> Motion {
    let track = |&(name, value): &(&str, f32)| Track { name: name.into(), unit: "", samples: vec![value; 3] };
    Motion::from(Targets::new(&[vec![angle; 3]], 2.0 * TICK))
        .with_events(events)
        .with_tracks(tracks.iter().map(track).collect())
        .with_end_phase(Phase(vec![(10.0 * angle) as u8]))
}

fn fail(tick: u32, joint: usize) -> Event {
    Event { tick, change: Change::Fail { joint } }
}

#[test]
fn plain_table_has_no_events_tracks_or_phase() {
    let plain = Motion::standing(3, 0.1);
    assert!(plain.events().is_empty() && plain.tracks().is_empty());
    assert_eq!(plain.end_phase(), &Phase::default());
    assert_eq!((plain.targets().joints(), plain.duration()), (3, 0.1));
}

#[test]
fn events_are_sorted_stably_by_tick() {
    let motion = motion(0.0, vec![fail(2, 0), fail(1, 3), fail(0, 1), fail(1, 2)], &[]);
    assert_eq!(motion.events(), [fail(0, 1), fail(1, 3), fail(1, 2), fail(2, 0)]);
}

#[test]
fn chained_motions_shift_events_and_keep_the_last_phase() {
    let first = motion(0.1, vec![fail(1, 0)], &[]);
    let second = motion(0.2, vec![fail(2, 2), fail(0, 1)], &[]);
    let chain = Motion::chain(&[&first, &second, &second]);
    assert_eq!(chain.events(), [fail(1, 0), fail(2, 1), fail(4, 2), fail(4, 1), fail(6, 2)]);
    assert_eq!(chain.end_phase(), &Phase(vec![2]));
}

#[test]
fn chained_tracks_have_a_sample_each_tick() {
    let (a, both, none) = (&[("a", 1.0)][..], &[("b", 2.0), ("a", 3.0)][..], &[][..]);
    let samples = |parts: [&[(&str, f32)]; 2], track: usize| {
        let parts = parts.map(|tracks| motion(0.0, vec![], tracks));
        let chain = Motion::chain(&[&parts[0], &parts[1]]);
        assert_eq!(chain.tracks()[track].samples.len(), Targets::ticks(chain.duration()));
        chain.tracks()[track].samples.iter().map(f32::to_string).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(samples([a, both], 0), "1 1 3 3 3");
    assert_eq!(samples([a, both], 1), "NaN NaN 2 2 2");
    assert_eq!(samples([a, none], 0), "1 1 NaN NaN NaN");
    assert_eq!(samples([none, a], 0), "NaN NaN 1 1 1");
}

#[test]
fn chained_tables_follow_each_other() {
    let chain = Motion::chain(&[&motion(0.25, vec![], &[]), &motion(0.5, vec![], &[])]);
    let at = |time: f64| {
        let mut out = [0.0];
        chain.targets().at(time, &mut out);
        out[0]
    };
    assert_eq!((at(TICK), at(2.0 * TICK), chain.duration()), (0.25, 0.5, 4.0 * TICK));
}
