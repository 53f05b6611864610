//! Every key of the list is a term of its own.

use std::sync::Arc;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use schemars::schema_for;

use super::*;
use crate::contact::{Arena, ContactReport};
use crate::reward::RewardTerm;
use crate::rooms::Arenas;
use crate::seed::{Purpose, Seed, Stream};
use crate::testing::smallest;
use crate::world::{Solid, World};

/// What the smallest term of a key pays in a flight that has a little of everything.
fn paid(yaml: &str) -> Vec<f64> {
    let mut stream = Stream::of_agent(Seed(1), 0, 0, Purpose::Actions);
    let mut draw = |low: f32, high: f32| f64::from(stream.between(low, high));
    let mut trial = Trial::of(yaml);
    trial.team = vec![[[0.3], [0.1], [0.7]]; 4];
    trial.agent = 1;
    let block = Solid::block("block", Vector3::new(0.3, 0.8, 1.8), Vector3::new(0.7, 1.2, 2.2));
    let world = World { solids: vec![block], ..World::empty() };
    trial.arenas = Some(Arenas::Same(Arc::new(Arena::new(&world, &CF2X, ContactReport::Touch))));
    // The side of that block from which most of the flight comes.
    trial.nearest = Some([[-1.0], [0.0], [0.0], [0.3]]);
    // Somebody who walks there.
    trial.passing = Some([[0.2], [0.9], [1.8], [0.1], [0.1], [-0.2], [0.3]]);
    let mut pay = |step: u32| {
        // Towards the landing zone of the smallest terms, and from there away, most along x.
        let way = f64::from(step) / 100.0;
        let beyond = [0.8 * (way - 1.0).max(0.0), 1.0, 2.0];
        let place = beyond.map(|middle| middle + draw(-0.5, 0.5) * (1.0 - way).abs());
        trial.swarm.velocity = [0; 3].map(|_| [draw(-1.0, 1.0) * way]);
        trial.swarm.body_rates = [0; 3].map(|_| [draw(-3.0, 3.0)]);
        trial.swarm.rotor_speeds = [0; 4].map(|_| [draw(1000.0, 2000.0)]);
        trial.previous_action = trial.action;
        trial.action = [0; 4].map(|_| draw(-1.0, 1.0));
        trial.previous_distance = trial.distance;
        trial.distance = draw(0.0, 1.5);
        let Attitude { w, x, y, z } = turn([draw(-0.5, 0.5), 0.6, draw(0.1, 0.6)], draw(-2.0, 2.0));
        let norm = (w * w + x * x + y * y + z * z).sqrt();
        trial.swarm.attitude = [w, x, y, z].map(|part| [part / norm]);
        trial.touches = [0; 2].map(|_| [f64::from(u8::from(draw(0.0, 1.0) < 0.3))]);
        let [success, failure, time_up] = [0; 3].map(|_| [f64::from(u8::from(draw(0.0, 1.0) < 0.2))]);
        trial.ends = crate::term::Ends { success, failure, time_up };
        trial.at(place[0], place[1], place[2])
    };
    (0..200).map(&mut pay).collect()
}

#[test]
fn every_key_reaches_its_own_term() {
    let schema = schema_for!(RewardTerm).to_value();
    let flights: Vec<(&str, Vec<f64>)> = RewardTerm::KEYS
        .iter()
        .map(|key| {
            let yaml = smallest(&schema, key);
            assert_eq!(Trial::of(&yaml).term.name(), *key);
            (*key, paid(&yaml))
        })
        .collect();
    let twin = |index: usize| flights[..index].iter().find(|(_, others)| *others == flights[index].1);
    let pays = |values: &[f64]| values.iter().any(|value| *value != 0.0);
    let idle: Vec<_> = flights.iter().filter(|(_, values)| !pays(values)).map(|(key, _)| key).collect();
    assert!(idle.is_empty(), "{idle:?} pay nothing");
    let twins: Vec<_> = (0..flights.len()).filter_map(|index| Some((flights[index].0, twin(index)?.0))).collect();
    assert!(twins.is_empty(), "{twins:?} pay the same");
}
