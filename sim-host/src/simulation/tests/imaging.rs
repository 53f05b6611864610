//! What drones with cameras see, and when.

use super::*;
use crate::camera::{OnboardCamera, Optics, Scene};
use crate::rooms::tests::ROOMS;

const WITH_CAMERA: &str = "\
aviary:
  goal_m: [2, 0, 1]
  solids: [{box: {center_m: [1.1, 0, 1], size_m: [0.2, 1, 2]}}]
start: {position: {within: {low_m: [-0.5, -0.5, 0.8], high_m: [0.5, 0.5, 1.2]}}, tilt_limit_deg: 40}
rewards: [{progress: {weight: 1}}]
success: {settle: {radius_m: 0.2, within_secs: 0.1}}
terminations: [collision]
episode_secs: 0.3
physics: {control_rate_hz: 50}
camera: {mounted: {columns: 16, rows: 12, channels: [rgb, depth], control_periods_per_image: 4}}
";

/// What the camera would show of a drone where it is now.
fn shown(simulation: &Simulation<8>, row: usize) -> Vec<u8> {
    let scenario = simulation.scenario();
    let camera: &OnboardCamera = scenario.camera.as_ref().unwrap();
    let (agent, lane) = simulation.agent(row);
    let image = Scene::new(&scenario.aviary_of(agent.room(lane)).world)
        .render(&camera.camera, &camera.view(&agent.motion(lane).pose));
    let mut bytes = vec![0; camera.image_len()];
    camera.write(&image, &mut bytes);
    bytes
}

fn image_of(images: &[u8], rows: usize, row: usize) -> &[u8] {
    let len = images.len() / rows;
    &images[row * len..][..len]
}

#[test]
fn an_image_is_taken_at_its_time_and_held_until_the_next() {
    let mut simulation = Simulation::<8>::new(&scenario(WITH_CAMERA), Seed(3), 0, 5);
    assert_eq!(simulation.scenario().camera.as_ref().unwrap().channels.len(), 2);
    let mut expected: Vec<Vec<u8>> = (0..5).map(|row| shown(&simulation, row)).collect();
    let (mut ends, mut held) = (0, 0);
    for step in 0..60 {
        simulation.step(&noise(step, ACTION_LEN * 5));
        for (row, expected) in expected.iter_mut().enumerate() {
            let (agent, lane) = simulation.agent(row);
            let seen = image_of(simulation.images(), 5, row);
            let running = simulation.outcomes()[row] == Outcome::Running;
            if !running {
                ends += 1;
                // Episodes end by time after 15 periods; the last image is of the twelfth.
                let last = image_of(simulation.final_images(), 5, row);
                assert!(simulation.outcomes()[row] == Outcome::Terminated || last == expected.as_slice());
            }
            if agent.period(lane).is_multiple_of(4) {
                expected.clone_from(&shown(&simulation, row));
            } else {
                held += usize::from(shown(&simulation, row) != *seen);
            }
            assert_eq!(seen, expected.as_slice(), "row {row} after step {step}");
        }
    }
    assert!(ends >= 10 && held > 100, "{ends} episodes ended, {held} images were held");
}

#[test]
fn images_do_not_depend_on_lanes_or_division_and_go_on_after_a_restore() {
    let scenario = scenario(WITH_CAMERA);
    let mut whole = Simulation::<64>::new(&scenario, Seed(4), 0, 9);
    let mut part = Simulation::<1>::new(&scenario, Seed(4), 6, 3);
    for step in 0..38 {
        let actions = noise(step, ACTION_LEN * 9);
        whole.step(&actions);
        let of_part: Vec<f32> = actions.chunks_exact(9).flat_map(|column| column[6..].to_vec()).collect();
        part.step(&of_part);
        let len = whole.images().len() / 9;
        assert!(whole.images()[6 * len..] == *part.images(), "step {step}");
        if step == 21 {
            // In the middle of a hold.
            let saved = whole.save();
            whole = Simulation::new(&scenario, Seed(4), 0, 9);
            assert!(whole.restore(&saved));
        }
    }
}

/// A camera with everything that a real one does, whose images are so late.
fn real(latency_periods: u32) -> Scenario {
    let mut scenario = scenario(WITH_CAMERA);
    if let Some(camera) = &mut scenario.camera {
        camera.optics =
            Optics { noise: 6.0, exposure: 0.3, shutter_secs: 0.02, latency_periods, focal: 0.05, turn: 0.03 };
    }
    scenario
}

#[test]
fn late_images_are_those_of_before_and_survive_a_restore() {
    let mut prompt = Simulation::<8>::new(&real(0), Seed(6), 0, 5);
    let mut late = Simulation::<8>::new(&real(6), Seed(6), 0, 5);
    let mut shown: Vec<Vec<u8>> = vec![prompt.images().to_vec()];
    let mut compared = 0;
    for step in 0..80 {
        let actions = noise(step, ACTION_LEN * 5);
        prompt.step(&actions);
        late.step(&actions);
        shown.push(prompt.images().to_vec());
        if step % 7 == 3 {
            let saved = late.save();
            late = Simulation::new(&real(6), Seed(6), 0, 5);
            assert!(late.restore(&saved));
        }
        for row in 0..5 {
            let (agent, lane) = late.agent(row);
            // Two images are on their way: they take six periods, one is taken every four.
            let period = agent.period(lane);
            let taken = if period < 10 { period } else { 6 + (period - 6) % 4 };
            let before = &shown[shown.len() - 1 - taken as usize];
            assert!(image_of(late.images(), 5, row) == image_of(before, 5, row), "row {row}, period {period}");
            compared += usize::from(period > 6);
        }
    }
    assert!(compared > 50, "{compared} late images");
}

#[test]
fn real_cameras_differ_from_episode_to_episode_but_not_in_depth() {
    let (perfect, real) = (scenario(WITH_CAMERA), real(0));
    let [perfect, spoiled] =
        [&perfect, &real].map(|scenario| Simulation::<8>::new(scenario, Seed(7), 0, 40).images().to_vec());
    let pixels = || perfect.chunks_exact(4).zip(spoiled.chunks_exact(4));
    assert!(pixels().any(|(one, other)| one[3] != other[3]), "another focal length, another way of looking");
    let mut straight = real;
    if let Some(camera) = &mut straight.camera {
        camera.optics = Optics { focal: 0.0, turn: 0.0, ..camera.optics };
    }
    let spoiled = Simulation::<8>::new(&straight, Seed(7), 0, 40).images().to_vec();
    let pixels = || perfect.chunks_exact(4).zip(spoiled.chunks_exact(4));
    assert!(pixels().all(|(one, other)| one[3] == other[3]), "depth is perfect");
    let brightness = |bytes: &[u8]| bytes.iter().map(|value| f64::from(*value)).sum::<f64>();
    let ratios: Vec<f64> = (perfect.chunks_exact(768).zip(spoiled.chunks_exact(768)))
        .map(|(one, other)| brightness(other) / brightness(one))
        .collect();
    let [least, most] = [f64::min, f64::max].map(|pick| ratios.iter().copied().reduce(pick).unwrap());
    assert!(least < 0.85 && most > 1.0, "{least} to {most}");
}

#[test]
fn in_drawn_rooms_cameras_see_the_room_of_the_episode() {
    let camera = "camera: { mounted: { columns: 16, rows: 12, channels: [labels] } }\nepisode_secs: 0.2";
    let scenario = crate::rooms::tests::checked(&ROOMS.replace("episode_secs: 1", camera)).unwrap();
    let mut whole = Simulation::<8>::new(&scenario, Seed(4), 0, 9);
    let mut part = Simulation::<1>::new(&scenario, Seed(4), 6, 3);
    let mut rooms = std::collections::BTreeSet::new();
    for step in 0..40 {
        for row in 0..9 {
            assert_eq!(image_of(whole.images(), 9, row), shown(&whole, row), "row {row} after {step} steps");
            rooms.insert((row, whole.room(row)));
        }
        let len = whole.images().len() / 9;
        assert!(whole.images()[6 * len..] == *part.images(), "after {step} steps");
        let actions = noise(step, 4 * 9);
        whole.step(&actions);
        part.step(&actions.chunks_exact(9).flat_map(|column| column[6..].to_vec()).collect::<Vec<f32>>());
        if step == 21 {
            let saved = whole.save();
            whole = Simulation::new(&scenario, Seed(4), 0, 9);
            assert!(whole.restore(&saved));
        }
    }
    assert!(rooms.len() > 20, "{} rooms of nine drones", rooms.len());
}

#[test]
fn frames_are_images_of_before_and_at_first_all_the_first() {
    let mut scenario = scenario(WITH_CAMERA);
    if let Some(camera) = &mut scenario.camera {
        (camera.frames, camera.images_per_frame, camera.control_periods_per_image) = (3, 2, 1);
    }
    let mut single = scenario.clone();
    if let Some(camera) = &mut single.camera {
        camera.frames = 1;
    }
    let mut simulations = [&scenario, &single].map(|scenario| Simulation::<8>::new(scenario, Seed(8), 0, 5));
    let mut shown: Vec<Vec<u8>> = Vec::new();
    for step in 0..40 {
        let [stacked, single] = &simulations;
        shown.push(single.images().to_vec());
        for row in 0..5 {
            let (agent, lane) = stacked.agent(row);
            let frame = |frame: u32| {
                let ago = (2 * frame).min(agent.period(lane)) as usize;
                image_of(&shown[shown.len() - 1 - ago], 5, row)
            };
            let frames = [frame(0), frame(1), frame(2)];
            let pixels = (0..16 * 12).flat_map(|pixel| frames.map(|bytes| &bytes[4 * pixel..][..4]).concat());
            assert!(pixels.eq(image_of(stacked.images(), 5, row).iter().copied()), "row {row}, step {step}");
        }
        for simulation in &mut simulations {
            simulation.step(&noise(step, ACTION_LEN * 5));
        }
        if step % 7 == 3 {
            let saved = simulations[0].save();
            simulations[0] = Simulation::new(&scenario, Seed(8), 0, 5);
            assert!(simulations[0].restore(&saved));
        }
    }
}

#[test]
fn a_blind_simulation_has_no_images_and_does_not_take_those_of_another() {
    let seeing = scenario(WITH_CAMERA);
    let blind = Scenario { camera: None, ..seeing.clone() };
    let mut simulation = Simulation::<8>::new(&blind, Seed(1), 0, 2);
    assert!(simulation.images().is_empty() && simulation.final_images().is_empty());
    let saved = Simulation::<8>::new(&seeing, Seed(1), 0, 2).save();
    assert!(!simulation.restore(&saved));
}

const FACING: &str = "\
aviary:
  goal_m: [0, 0, 1]
  movables: [{box: {center_m: [0.3, 0.6, 0.1], size_m: [0.6, 0.2, 0.2]}, mass_kg: 0.05}]
agents: {count: 2}
start:
  position:
    exactly: [{position_m: [0, 0, 0.5]}, {position_m: [0.6, 0, 0.5], heading_deg: 180}]
rewards: [{alive: {weight: 1}}]
success: {settle: {radius_m: 0.2, within_secs: 0.1}}
episode_secs: 1
camera: {mounted: {columns: 96, rows: 72, channels: [labels]}}
";

#[test]
fn drones_see_their_mates_and_what_moves_but_not_themselves() {
    let mut simulation = Simulation::<8>::new(&scenario(FACING), Seed(3), 0, 3);
    // Solids would come first; then the movable, and the two drones.
    let (movable, drones) = (2, [3, 4]);
    for step in 0..20 {
        for row in 0..6 {
            let (seen, drone) = (image_of(simulation.images(), 6, row), row / 3);
            assert!(seen.contains(&drones[1 - drone]), "row {row} does not see its mate after {step} steps");
            assert!(!seen.contains(&drones[drone]), "row {row} sees itself");
            assert!(seen.contains(&movable) || step > 0, "row {row} does not see the cube");
        }
        simulation.step(&[0.0; ACTION_LEN * 6]);
    }
}
