//! Motions: joint targets and events over time, as an engine executes them.

mod course;
mod event;
mod targets;

pub(crate) use course::Course;
pub use event::{Change, Event};
pub use targets::{TICK, Targets};

use crate::model::Phase;

/// Signal of a controller that is drawn beside the joints, such as a role or a phase.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Name in tables and pictures.
    pub name: String,
    /// Unit, empty for a pure number.
    pub unit: &'static str,
    /// One value for each tick, the first at time 0; NaN where there is nothing to draw.
    pub samples: Vec<f32>,
}

/// Joint targets and events over time. Controllers compile motions, and engines simulate them.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    targets: Targets,
    events: Vec<Event>,
    tracks: Vec<Track>,
    end_phase: Phase,
}

impl From<Targets> for Motion {
    /// Returns the motion of a plain table: no events, no tracks and an empty phase.
    fn from(targets: Targets) -> Self {
        Self { targets, events: Vec::new(), tracks: Vec::new(), end_phase: Phase::default() }
    }
}

impl Motion {
    /// Returns a motion with all joints at 0 for `duration` s.
    pub fn standing(joints: usize, duration: f64) -> Self {
        Targets::zero(joints, duration).into()
    }

    /// Returns the same motion with these events. Events at the same tick act in the given order.
    pub fn with_events(mut self, mut events: Vec<Event>) -> Self {
        events.sort_by_key(|event| event.tick);
        self.events = events;
        self
    }

    /// Returns the same motion with these targets, of the same number of joints and duration.
    pub fn with_targets(mut self, targets: Targets) -> Self {
        self.targets = targets;
        self
    }

    /// Returns the same motion with these tracks.
    pub fn with_tracks(mut self, tracks: Vec<Track>) -> Self {
        self.tracks = tracks;
        self
    }

    /// Returns the same motion with this phase of the controller at the end.
    pub fn with_end_phase(mut self, phase: Phase) -> Self {
        self.end_phase = phase;
        self
    }

    /// Returns the joint targets.
    pub fn targets(&self) -> &Targets {
        &self.targets
    }

    /// Returns the events in the order in which they act.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Returns the signals of the controller that are drawn.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Returns the state of the controller at the end, from which it continues.
    pub fn end_phase(&self) -> &Phase {
        &self.end_phase
    }

    /// Returns the duration, s.
    pub fn duration(&self) -> f64 {
        self.targets.duration()
    }

    /// Joins motions one after the other, with the end phase of the last. Each but the last must last a whole number of
    /// ticks. Tracks are identified by name and unit, and are NaN during the motions that lack them.
    pub fn chain(motions: &[&Motion]) -> Self {
        let tables: Vec<&Targets> = motions.iter().map(|motion| &motion.targets).collect();
        let (mut events, mut tracks) = (Vec::new(), Vec::<Track>::new());
        let mut first = 0;
        for motion in motions {
            events.extend(motion.events.iter().map(|event| Event { tick: first + event.tick, ..*event }));
            // The last sample of a motion is the first of the next one.
            tracks.iter_mut().for_each(|track| track.samples.resize(first as usize, f32::NAN));
            for track in &motion.tracks {
                let same = tracks.iter().position(|t| t.name == track.name && t.unit == track.unit);
                let at = same.unwrap_or_else(|| {
                    tracks.push(Track { samples: vec![f32::NAN; first as usize], ..track.clone() });
                    tracks.len() - 1
                });
                tracks[at].samples.extend(&track.samples);
            }
            first += motion.targets.whole_ticks();
        }
        let targets = Targets::chain(&tables);
        let ticks = Targets::ticks(targets.duration());
        tracks.iter_mut().for_each(|track| track.samples.resize(ticks, f32::NAN));
        let end_phase = motions.last().map_or_else(Phase::default, |last| last.end_phase.clone());
        Self::from(targets).with_events(events).with_tracks(tracks).with_end_phase(end_phase)
    }
}
