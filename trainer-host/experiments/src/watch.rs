//! The newest policy of a training run, flown in real time to be looked at while training goes on.

use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use kestrel_draw::recorded_flight::{DroneFlight, FlightRecording, Frame, Placement};
use kestrel_draw::viewer::Glimpse;
use kestrel_learn::actor_critic::Actor;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::simulation::Simulation;
use kestrel_sim::world::Pose;

use crate::evaluation::Flyer;
use crate::experiment_config::Experiment;
use crate::recording::{Step, Track, fly_watched};
use crate::results::starts;

/// How long the end of a flight is looked at.
const PAUSE: Duration = Duration::from_secs(1);

/// How often somebody who waits for a policy looks.
const PATIENCE: Duration = Duration::from_millis(20);

/// The newest policy and the environment steps it was trained for; clones share it.
#[derive(Clone, Debug, Default)]
pub struct NewestPolicy(Arc<Mutex<Option<(Actor, u64)>>>);

impl NewestPolicy {
    /// Replaces it.
    pub fn offer(&self, actor: &Actor, steps: u64) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((actor.clone(), steps));
    }

    fn get(&self) -> Option<(Actor, u64)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Flies the tasks in turn, from one start of their evaluation after the other, each with the policy that is the newest when
/// the flight begins, in real time, until nobody looks any more or `over`. Training does not depend on it.
pub fn fly_newest(tasks: &[Experiment], newest: &NewestPolicy, tell: &Sender<Glimpse>, over: &dyn Fn() -> bool) {
    let mut flight = 0;
    while !over() {
        let Some((actor, steps)) = newest.get() else {
            thread::sleep(PATIENCE);
            continue;
        };
        let (task, start) = (&tasks[flight % tasks.len()], (flight / tasks.len()) as u32);
        let starts = starts(task);
        let title = format!("{}: after {steps} steps", task.name);
        let mut teller = Teller::new(title, task.evaluation.scenario.physics.control_secs(), tell);
        let start = start % u32::try_from(starts.episodes.max(1)).unwrap_or(u32::MAX);
        let looked_at = &mut |simulation: &Simulation<1, f64>, tracks: &[Track]| {
            !over() && teller.tell(simulation, tracks, &task.evaluation.scenario).is_some()
        };
        let recording = fly_watched(task, Flyer::Actor(&actor), (starts, start), looked_at);
        if recording.drones.iter().any(|track| track.ending.is_empty()) {
            return;
        }
        thread::sleep(PAUSE);
        flight += 1;
    }
}

/// Tells of one flight as it is flown, no faster than it is.
struct Teller<'a> {
    title: String,
    control: Duration,
    tell: &'a Sender<Glimpse>,
    /// When it began.
    begin: Option<Instant>,
    periods: u32,
    /// Drones whose ending has been told.
    ended: Vec<bool>,
}

impl<'a> Teller<'a> {
    fn new(title: String, control_secs: f32, tell: &'a Sender<Glimpse>) -> Self {
        let control = Duration::from_secs_f32(control_secs);
        Self { title, control, tell, begin: None, periods: 0, ended: Vec::new() }
    }

    /// Tells of a control period when it is due; nothing when nobody looks any more.
    fn tell(&mut self, simulation: &Simulation<1, f64>, tracks: &[Track], scenario: &Scenario) -> Option<()> {
        let movables = simulation.movables(0);
        let Some(begin) = self.begin else {
            self.begin = Some(Instant::now());
            self.ended = vec![false; tracks.len()];
            let flight = FlightRecording {
                title: self.title.clone(),
                control_secs: self.control.as_secs_f32(),
                drones: tracks.iter().filter_map(begun).collect(),
                movables: movables.iter().map(|pose| vec![Placement::of(pose)]).collect(),
            };
            let scenario = Arc::new(scenario.in_room(simulation.room(0)));
            return self.tell.send(Glimpse::Begins(scenario, flight)).ok();
        };
        self.periods += 1;
        thread::sleep((begin + self.control * self.periods).saturating_duration_since(Instant::now()));
        self.tell.send(Glimpse::GoesOn(frame(tracks, &movables, &self.ended))).ok()?;
        for (drone, track) in tracks.iter().enumerate().filter(|(_, track)| !track.ending.is_empty()) {
            if !self.ended[drone] {
                self.ended[drone] = true;
                let (ending, success) = (track.ending.clone(), track.success);
                self.tell.send(Glimpse::Ends { drone, ending, success }).ok()?;
            }
        }
        Some(())
    }
}

/// A drone at its start.
fn begun(track: &Track) -> Option<DroneFlight> {
    let goal = track.goal.map(|metres| metres as f32).into();
    Some(DroneFlight::beginning(Some(goal), track.moments.first()?.placed.placement()))
}

/// Where everything is now. A drone whose flight has ended stays where it was, and is paid nothing more.
fn frame(tracks: &[Track], movables: &[Pose], ended: &[bool]) -> Frame {
    let placement = |track: &Track| track.moments.last().map(|moment| moment.placed.placement());
    let paid = |(track, ended): (&Track, &bool)| {
        if *ended { 0.0 } else { track.steps.last().map_or(0.0, Step::paid) }
    };
    Frame {
        drones: tracks.iter().filter_map(placement).collect(),
        movables: movables.iter().map(Placement::of).collect(),
        rewards: tracks.iter().zip(ended).map(paid).collect(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;
    use crate::experiment_config::load;
    use crate::training_run::untrained_actor;

    #[test]
    fn a_flight_is_told_from_its_start_to_its_end_until_nobody_looks() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/hover.yaml");
        let task = load(&path, &[]).unwrap();
        let newest = NewestPolicy::default();
        newest.offer(&untrained_actor(&task).unwrap(), 7);
        let (tell, glimpses) = channel();
        let flying = thread::spawn(move || fly_newest(&[task], &newest, &tell, &|| false));
        let mut told = Vec::new();
        while let Ok(glimpse) = glimpses.recv() {
            let ends = matches!(glimpse, Glimpse::Ends { .. });
            told.push(glimpse);
            if ends {
                break;
            }
        }
        let [Glimpse::Begins(_, begun), between @ .., Glimpse::Ends { drone: 0, ending, .. }] = &told[..] else {
            panic!("{told:?}")
        };
        assert_eq!((begun.title.as_str(), begun.drones[0].frames.len()), ("hover: after 7 steps", 1));
        assert!(!ending.is_empty() && begun.drones[0].goal.is_some());
        // Untrained, it is soon too far away.
        assert!(between.len() > 10, "{} periods", between.len());
        assert!(between.iter().all(|glimpse| matches!(glimpse, Glimpse::GoesOn(_))));
        drop(glimpses);
        flying.join().unwrap();
    }
}
