//! The same bits from any number of lanes, any division and any point of resumption, whatever is simulated.

use std::collections::BTreeMap;

use kestrel_core::action::{ControlMemory, Controls, Setpoint};
use kestrel_core::airframe::CRAZYFLIE_2_1;
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator;
use kestrel_core::vehicle::{Air, Vehicle};

use super::*;
use crate::outcome::Ending::{self, Collision, Teammate, TimeLimit};
use crate::physics::Physics;
use crate::swarm::{Swarm, advance_all};

/// Environments of a test, more than a block of eight.
const ENVIRONMENTS: usize = 11;

/// Bits of every step, by environment, and all episodes.
#[derive(Debug, Default, PartialEq)]
struct Flights {
    traces: BTreeMap<u32, Vec<u64>>,
    episodes: Vec<Episode>,
}

/// Noise that depends on nothing but step, environment, drone and value, `[action_len][rows]`.
pub(super) fn actions_of(scenario: &Scenario, first: u32, count: usize, step: usize) -> Vec<f32> {
    let drones = scenario.agents.count as usize;
    let mut actions = vec![0.0; scenario.action.len() * drones * count];
    for environment in 0..count {
        for drone in 0..drones {
            let mut stream =
                Stream::of_agent(Seed(step as u64), first + environment as u32, drone as u32, Purpose::Actions);
            for column in actions.chunks_exact_mut(drones * count) {
                column[drone * count + environment] = stream.between(-1.0, 1.0);
            }
        }
    }
    actions
}

impl Flights {
    /// Appends what a step left.
    fn add<const LANES: usize>(&mut self, simulation: &mut Simulation<LANES>, first: u32) {
        let (rows, count) = (simulation.rows(), simulation.environments());
        for row in 0..rows {
            let trace = self.traces.entry(first + (row % count) as u32).or_default();
            trace.push(u64::from(simulation.rewards()[row].to_bits()));
            trace.push(simulation.outcomes()[row] as u64);
            let columns = [simulation.observations(), simulation.privileged()].map(|all| all.chunks_exact(rows));
            trace.extend(columns.into_iter().flatten().map(|column| u64::from(column[row].to_bits())));
        }
        for environment in 0..count {
            let bits = simulation.movables(environment).into_iter().flat_map(|pose| {
                let q = pose.world_from_body;
                let [x, y, z] = pose.position.into();
                [x, y, z, q.w, q.x, q.y, q.z].map(f64::to_bits)
            });
            self.traces.entry(first + environment as u32).or_default().extend(bits);
        }
        self.episodes.extend(simulation.take_episodes());
    }

    /// Episodes in an order that does not depend on blocks.
    fn sorted(mut self) -> Self {
        self.episodes.sort_by_key(|episode| (episode.environment, episode.agent));
        self
    }
}

fn fly<const LANES: usize>(scenario: &Scenario, parts: &[(u32, usize)], steps: usize) -> Flights
where
    Simulation<LANES>: Compiled<f32>,
{
    let mut flights = Flights::default();
    for &(first, count) in parts {
        let mut simulation = Simulation::<LANES>::new(scenario, Seed(5), first, count);
        for step in 0..steps {
            simulation.step(&actions_of(scenario, first, count, step));
            flights.add(&mut simulation, first);
        }
    }
    flights.sorted()
}

/// As [`fly`], through a saved state that is read back into a simulation of another past.
fn fly_in_two<const LANES: usize>(scenario: &Scenario, steps: usize) -> Flights
where
    Simulation<LANES>: Compiled<f32>,
{
    let mut flights = Flights::default();
    let mut simulation = Simulation::<LANES>::new(scenario, Seed(5), 0, ENVIRONMENTS);
    for step in 0..steps {
        if step == steps / 2 {
            let saved = simulation.save();
            let mut other = Simulation::<LANES>::new(scenario, Seed(77), 0, ENVIRONMENTS);
            for past in 0..5 {
                other.step(&actions_of(scenario, 40, ENVIRONMENTS, past));
            }
            assert!(other.restore(&saved));
            simulation = other;
        }
        simulation.step(&actions_of(scenario, 0, ENVIRONMENTS, step));
        flights.add(&mut simulation, 0);
    }
    flights.sorted()
}

/// Holds a scenario to its bits; some of its episodes must end by each of `endings`.
pub(super) fn assert_deterministic(yaml: &str, steps: usize, endings: &[Ending]) {
    let scenario = scenario(yaml);
    let reference = fly::<64>(&scenario, &[(0, ENVIRONMENTS)], steps);
    for ending in endings {
        assert!(reference.episodes.iter().any(|episode| episode.ending == *ending), "no {}", ending.name());
    }
    assert!(reference == fly::<1>(&scenario, &[(0, ENVIRONMENTS)], steps), "one lane");
    assert!(reference == fly::<8>(&scenario, &[(0, ENVIRONMENTS)], steps), "eight lanes");
    assert!(reference == fly::<8>(&scenario, &[(0, 3), (3, 1), (4, 7)], steps), "divided");
    assert!(reference == fly_in_two::<64>(&scenario, steps), "restored, 64 lanes");
    assert!(reference == fly_in_two::<1>(&scenario, steps), "restored, one lane");
}

/// Three drones in a small room fly into each other's downwash, each other and the walls.
const CROWD: &str = "
aviary: { goal_m: [0, 0, 1], room: { low_m: [-0.5, -0.5, 0], high_m: [0.5, 0.5, 2] } }
agents: { count: 3 }
physics: { downwash: true, ground_effect: true, substeps: 2, control_rate_hz: 50 }
randomisation: { mass_fraction: 0.1, wind_speed_m_per_s: 1 }
start: { position: { within: { low_m: [-0.3, -0.3, 0.3], high_m: [0.3, 0.3, 1.5] } }, speed_limit_m_per_s: 1 }
rewards: [ proximity: { weight: 1, scale_m: 0.5 }, no_collision: { weight: 1 }, meeting: { weight: 1 } ]
episode_secs: 0.6
success: { settle: { radius_m: 0.5, within_secs: 0.3 } }
";

#[test]
fn several_drones_with_downwash_and_reported_contacts() {
    let together = format!("{CROWD}terminations: [ collision ]");
    assert_deterministic(&together, 60, &[Collision, Teammate]);
    let alone = together.replace("count: 3", "count: 3, ends: alone, rewards: shared");
    assert_deterministic(&alone, 60, &[Collision, TimeLimit]);
    let under = alone.replace("ground_effect: true", "ground_effect: true, ceiling_effect_m: 2");
    assert_deterministic(&under, 60, &[Collision, TimeLimit]);
}

#[test]
fn several_drones_that_push_each_other() {
    assert_deterministic(CROWD, 60, &[TimeLimit]);
}

/// A drone with everything that real flights show, late, and unlike its neighbours, between walls.
const REAL: &str = "
aviary: { goal_m: [0, 0, 1], room: { low_m: [-0.5, -0.5, 0], high_m: [0.5, 0.5, 2] } }
vehicle: { airframe: crazyflie_2_1 }
physics: { substeps: 4, control_rate_hz: 50 }
action: { thrust_body_rates: {} }
latency: { state_secs: [0, 0.015], motor_secs: [0.001, 0.02] }
randomisation:
  mass_fraction: 0.1
  rotor_lag_share: [0.2, 1.3]
  torque_share: [0.8, 6]
  effects_fraction: 0.5
  rate_damping_share: [0, 1]
  motor_fraction: 0.05
  battery_share: [0.9, 1.02]
  wind_speed_m_per_s: 1
start: { position: { within: { low_m: [-0.3, -0.3, 0.3], high_m: [0.3, 0.3, 1.5] } }, speed_limit_m_per_s: 1 }
rewards: [ proximity: { weight: 1, scale_m: 0.5 } ]
episode_secs: 0.6
success: { settle: { radius_m: 0.5, within_secs: 0.3 } }
";

#[test]
fn late_drones_with_effects() {
    assert_deterministic(REAL, 60, &[TimeLimit]);
    assert_deterministic(&format!("{REAL}terminations: [ collision ]"), 60, &[Collision]);
}

/// The same with delays that jitter and a rate loop at 1 kHz.
fn jittering() -> String {
    REAL.replace("substeps: 4", "substeps: 20")
        .replace("thrust_body_rates: {}", "thrust_body_rates: { rate_loop: { gyro_cutoff_hz: 80 } }")
        .replace(
            "motor_secs: [0.001, 0.02]",
            "motor_secs: [0.001, 0.01], state_jitter_secs: 0.004, motor_jitter_secs: 0.01",
        )
}

#[test]
fn drones_whose_delays_jitter_with_a_rate_loop() {
    assert_deterministic(&jittering(), 60, &[TimeLimit]);
    assert_deterministic(&format!("{}terminations: [ collision ]", jittering()), 60, &[Collision]);
}

/// The same with positions that are late, outages and errors of every number.
fn misled() -> String {
    jittering().replace(
        "state_secs: [0, 0.015],",
        "state_secs: [0, 0.015], position_extra_secs: [0.01, 0.05], outages: { per_sec: 5, secs: [0.02, 0.1] },",
    ) + "estimate:
  position_m: { noise: 0.01, drift: 0.05 }
  velocity_m_per_s: { noise: 0.05, drift: 0.05 }
  tilt_deg: { noise: 0.5, drift: 1 }
  heading_deg: { drift: 3 }
  body_rates_rad_per_s: { noise: 0.05 }
"
}

#[test]
fn late_drones_whose_estimates_are_wrong() {
    assert_deterministic(&misled(), 60, &[TimeLimit]);
    assert_deterministic(&format!("{}terminations: [ collision ]", misled()), 60, &[Collision]);
}

/// The same by velocities whose controller has an integral.
fn steadied() -> String {
    REAL.replace("thrust_body_rates: {}", "velocity: { integral_gain_per_s2: 6 }")
}

#[test]
fn late_drones_whose_velocities_have_an_integral() {
    assert_deterministic(&steadied(), 60, &[TimeLimit]);
    assert_deterministic(&format!("{}terminations: [ collision ]", steadied()), 60, &[Collision]);
}

#[test]
fn a_rate_loop_stops_a_turn_that_held_commands_drive() {
    let looped = REAL
        .replace("substeps: 4, control_rate_hz: 50", "substeps: 100, control_rate_hz: 10")
        .replace(", room: { low_m: [-0.5, -0.5, 0], high_m: [0.5, 0.5, 2] }", "")
        .replace("episode_secs: 0.6", "episode_secs: 60")
        .replace("thrust_body_rates: {}", "thrust_body_rates: { rate_gains_per_s: [30, 30, 8] }");
    let inner = looped.replace("[30, 30, 8]", "[30, 30, 8], rate_loop: {}");
    let rate_after = |yaml: &str| {
        let scenario = scenario(&yaml.replace("wind_speed_m_per_s: 1", "wind_speed_m_per_s: 0"));
        let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
        let mut state = simulation.state(0);
        state.body_rates = nalgebra::Vector3::new(4.0, 0.0, 0.0);
        simulation.put(0, state);
        // Hover thrust, and no rate: commands that last a tenth of a second.
        for _ in 0..20 {
            simulation.step(&[0.0; 4]);
        }
        simulation.state(0).body_rates.norm()
    };
    // What is held for that long overshoots, more and more.
    let (held, followed) = (rate_after(&looped), rate_after(&inner));
    assert!(held > 1.0 && followed < 0.3, "{held} {followed}");
}

#[test]
fn rotor_speeds_that_a_pilot_commands_are_followed_as_its_actions_are() {
    follows_what_is_commanded(&jittering());
    follows_what_is_commanded(&steadied());
}

/// For two episodes, of which each begins with a controller that remembers nothing.
fn follows_what_is_commanded(yaml: &str) {
    let scenario = scenario(yaml);
    let mut memory = ControlMemory::new();
    let controls = Controls::<f32>::new(&scenario.action);
    let mut acting = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
    let mut commanding = acting.clone();
    let (setpoint, secs) = (Setpoint::at([0.0; 3].into()), scenario.physics.control_secs());
    for step in 0..60 {
        let actions = actions_of(&scenario, 0, 1, step);
        let [a, b, c, d] = actions[..] else { panic!("four") };
        let state = commanding.known_state(0);
        if step % scenario.episode_steps() as usize == 0 {
            memory = ControlMemory::new();
        }
        let targets = controls.rotor_targets(&[a, b, c, d, 0.0, 0.0], &state, &setpoint, &mut memory, secs);
        acting.step(&actions);
        commanding.step_with_rotor_speeds(&actions, &[targets]);
        assert_eq!(acting.state(0), commanding.state(0), "step {step}");
    }
}

#[test]
fn jitter_makes_the_state_older_by_up_to_as_much() {
    let yaml = REAL.replace("state_secs: [0, 0.015]", "state_secs: [0.005, 0.005], state_jitter_secs: 0.01");
    let yaml = yaml
        .replace("episode_secs: 0.6", "episode_secs: 60")
        .replace("wind_speed_m_per_s: 1", "wind_speed_m_per_s: 0");
    let mut simulation = Simulation::<8>::new(&scenario(&yaml), Seed(3), 0, 4);
    let hover = [simulation.state(0).rotor_speeds; 4];
    let mut ages = Vec::new();
    for _ in 0..100 {
        for row in 0..4 {
            let mut state = simulation.state(row);
            (state.position, state.velocity) = ([0.0, 0.0, 1.0].into(), [1.0, 0.0, 0.0].into());
            (state.world_from_body, state.body_rates) = (Attitude::level(), [0.0; 3].into());
            simulation.put(row, state);
        }
        simulation.step_with_rotor_speeds(&[0.0; 16], &hover);
        ages.extend((0..4).map(|row| simulation.state(row).position.x - simulation.known_state(row).position.x));
    }
    let (least, most) =
        ages.iter().fold((1.0_f32, 0.0_f32), |(least, most), age| (least.min(*age), most.max(*age)));
    assert!((0.0045..0.0055).contains(&least), "{least}");
    assert!((0.0143..0.0155).contains(&most), "{most}");
}

#[test]
fn a_battery_sags_in_lanes_as_it_does_for_one_drone() {
    let physics = Physics::clean(Integrator::SemiImplicitEuler, 1, 500.0);
    let flown = |sag: f64| {
        let mut airframe = CRAZYFLIE_2_1;
        airframe.effects.battery_sag = sag;
        let limit = airframe.rotor_speed_limit as f32;
        let (mut swarms, vehicle) = ([Swarm::<8>::new(&airframe)], Vehicle::<f32>::new(&airframe));
        let start = swarms[0].state(5);
        advance_all(&mut swarms, &physics, &[[limit; 8]; 4], 100);
        let secs = physics.substep_secs() as f32;
        let alone = (0..100).fold(start, |state, _| {
            Integrator::SemiImplicitEuler.advance(&vehicle, &state, &[limit; 4], &Air::still(), secs)
        });
        assert_eq!(swarms[0].state(5), alone, "a sag of {sag}");
        alone.rotor_speeds[0] / limit
    };
    assert!(flown(0.0) > flown(0.2) + 0.05);
}

#[test]
fn a_drone_knows_what_was_so_many_substeps_ago() {
    // A substep is 5 ms: 12.5 ms ago is the middle between the states after the first and the second of four.
    let late = |secs: &str| scenario(&REAL.replace("[0, 0.015]", &format!("[{secs}, {secs}]")));
    let mut simulation = Simulation::<8>::new(&late("0.0125"), Seed(3), 0, 4);
    let start = simulation.state(0);
    assert_eq!(simulation.known_state(0), start, "at its start");
    simulation.step_with_rotor_speeds(&[0.0; 16], &[start.rotor_speeds; 4]);
    // Free flight of the first moments, by the velocities that the substeps end with.
    let (known, now) = (simulation.known_state(0), simulation.state(0));
    let passed = f64::from((now.position - known.position).norm());
    let expected = 0.0125 * f64::from(now.velocity.norm());
    assert!((passed / expected - 1.0).abs() < 0.1, "{passed} m in 12.5 ms, expected about {expected}");
    assert!((known.world_from_body.up_cosine() - 1.0).abs() < 0.1);
    let before = simulation.state(0);
    let mut whole = Simulation::<8>::new(&late("0.02"), Seed(3), 0, 4);
    whole.step_with_rotor_speeds(&[0.0; 16], &[start.rotor_speeds; 4]);
    assert_eq!(whole.known_state(0).position, start.position, "a control period ago");
    assert_eq!(whole.state(0), before, "what it knows changes no flight of the same rotors");
}

#[test]
fn motors_hear_a_command_when_its_delay_is_over() {
    let delayed = |secs: &str, command: f32| {
        let scenario = scenario(&REAL.replace("[0.001, 0.02]", &format!("[{secs}, {secs}]")));
        let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
        let hover = simulation.state(0).rotor_speeds;
        simulation.step_with_rotor_speeds(&[0.0; 4], &[hover.map(|speed| command * speed)]);
        simulation.state(0).rotor_speeds.iter().zip(hover).map(|(now, before)| now - before).sum::<f32>()
    };
    let gains = ["0", "0.005", "0.01", "0.02"].map(|secs| delayed(secs, 1.2));
    assert!(gains.windows(2).all(|pair| pair[0] > pair[1] + 20.0), "{gains:?}");
    // A control period late, they follow what was commanded before, whatever is commanded now.
    assert_eq!(gains[3], delayed("0.02", 0.5));
}

#[test]
fn every_part_of_a_real_drone_is_drawn_and_nothing_else_for_a_model_without_effects() {
    let drawn = scenario(REAL);
    let begin = |scenario: &Scenario, environment| {
        crate::reset::begin::<f64>(scenario, (0, 0), &mut Stream::new(Seed(1), environment, Purpose::Reset))
    };
    let nominal = Vehicle::<f64>::new(&drawn.airframe).effects.unwrap();
    let vehicles: Vec<_> = (0..64).map(|environment| begin(&drawn, environment)).collect();
    let spread = |part: &dyn Fn(&kestrel_core::vehicle::EffectGains<f64>) -> f64| {
        let shares: Vec<f64> =
            vehicles.iter().map(|begun| part(&begun.vehicle.effects.unwrap()) / part(&nominal)).collect();
        [shares.iter().copied().fold(f64::INFINITY, f64::min), shares.iter().copied().fold(0.0, f64::max)]
    };
    let near = |[least, most]: [f64; 2], low: f64, high: f64| {
        let slack = 0.15 * (high - low);
        (low - 1e-6..low + slack).contains(&least) && (high - slack..high + 1e-6).contains(&most)
    };
    assert!(near(spread(&|effects| effects.flapping[0]), 0.5, 1.5));
    assert!(near(spread(&|effects| effects.rotor_inertia.z), 0.5, 1.5));
    assert!(near(spread(&|effects| effects.body_drag * 1.0), 0.45, 1.67), "over a mass of ± 10 %");
    assert!(near(spread(&|effects| effects.rate_damping.z), 0.0, 1.0));
    assert!(near(spread(&|effects| effects.rotor_thrusts[2]), 0.95, 1.05));
    assert!(near(spread(&|effects| effects.battery), 0.9, 1.02));
    let vehicle = Vehicle::<f64>::new(&drawn.airframe);
    let share = |part: &dyn Fn(&Vehicle<f64>) -> f64| {
        let shares = vehicles.iter().map(|begun| part(&begun.vehicle) / part(&vehicle));
        shares.fold([f64::INFINITY, 0.0], |[least, most], share| [share.min(least), share.max(most)])
    };
    assert!(near(share(&|vehicle| vehicle.turning_gains.z), 0.8, 6.0));
    assert!(near(share(&|vehicle| 1.0 / vehicle.rotor_rise_rate), 0.2, 1.3));
    let delays: Vec<f32> = vehicles.iter().map(|begun| begun.delays.state).collect();
    assert!(delays.iter().all(|secs| (0.0..=0.015).contains(secs)) && delays.iter().any(|secs| *secs > 0.012));
    assert!(begin(&hover(), 0).vehicle.effects.is_none());
}

#[test]
fn what_cannot_be_late_or_drawn_is_refused() {
    let refused = |yaml: &str| {
        let document = Document::parse("trial.yaml", yaml).unwrap();
        Scenario::of("trial", &document).unwrap_err().to_string()
    };
    let late = refused(&REAL.replace("[0, 0.015]", "[0, 0.03]"));
    assert!(late.contains("latency.state_secs") && late.contains("the control period"), "{late}");
    let turned = refused(&REAL.replace("[0, 0.015]", "[0.01, 0.005]"));
    assert!(turned.contains("0.01 or more"), "{turned}");
    let jitters = refused(&REAL.replace("[0, 0.015]", "[0, 0.015], state_jitter_secs: 0.006"));
    assert!(jitters.contains("state_jitter_secs") && jitters.contains("the control period"), "{jitters}");
    let coarse = refused(&REAL.replace("rates: {}", "rates: { rate_loop: { gyro_cutoff_hz: 100 } }"));
    assert!(coarse.contains("gyro_cutoff_hz") && coarse.contains("half of the physics"), "{coarse}");
    let nested = refused(&REAL.replace("thrust_body_rates: {}", "velocity: { rates: { rate_loop: {} } }"));
    assert!(
        nested.contains("velocity.rates.rate_loop") && nested.contains("only `thrust_body_rates`"),
        "{nested}"
    );
    let plain = refused(&REAL.replace("crazyflie_2_1", "cf2x"));
    assert!(plain.contains("no `effects`"), "{plain}");
    let twice = refused(&REAL.replace("mass_fraction", "torque_fraction"));
    assert!(twice.contains("torque_share") && twice.contains("one of the two"), "{twice}");
    let bullet =
        REAL.replace("{ substeps: 4,", "{ bullet: { mode: pyb }, substeps: 5,").replace("mass_fraction: 0.1", "");
    let calm = refused(&bullet);
    assert!(calm.contains("the physics `bullet`"), "{calm}");
}

/// Drones fall on a stack of bricks and push them about.
const BRICKS: &str = "
aviary:
  goal_m: [0, 0, 0.5]
  movables:
    - { box: { center_m: [0, 0, 0.05], size_m: [0.1, 0.1, 0.1] }, mass_kg: 0.02 }
    - { box: { center_m: [0, 0.02, 0.15], size_m: [0.1, 0.1, 0.1] }, mass_kg: 0.02 }
    - { cylinder: { center_m: [0.2, 0, 0.05], radius_m: 0.04, height_m: 0.1 }, mass_kg: 0.01 }
physics: { substeps: 4, control_rate_hz: 50 }
start: { position: { within: { low_m: [-0.1, -0.1, 0.25], high_m: [0.1, 0.1, 0.4] } }, speed_limit_m_per_s: 2 }
rewards: [ no_collision: { weight: 1 } ]
episode_secs: 0.6
success: { settle: { radius_m: 0.5, within_secs: 0.3 } }
";

#[test]
fn drones_that_push_bricks() {
    assert_deterministic(BRICKS, 60, &[TimeLimit]);
    let bullet = BRICKS.replace("substeps: 4, ", "bullet: { mode: pyb }, substeps: 5, ");
    assert_deterministic(&bullet, 60, &[TimeLimit]);
}

#[test]
fn bricks_fall_again_in_every_episode() {
    let scenario = scenario(BRICKS);
    let mut simulation = Simulation::<8>::new(&scenario, Seed(1), 0, 3);
    let standing = simulation.movables(0);
    for step in 0..29 {
        simulation.step(&actions_of(&scenario, 0, 3, step));
    }
    assert!((0..3).any(|environment| simulation.movables(environment) != standing));
    simulation.step(&actions_of(&scenario, 0, 3, 29));
    assert!((0..3).all(|environment| simulation.movables(environment) == standing));
}

/// Two drones under the reference's physics with everything on, near the floor and each other.
const BULLET: &str = "
aviary: { goal_m: [0, 0, 1], solids: [ { low_m: [0.3, -1, 0], high_m: [0.4, 1, 1] } ] }
agents: { count: 2, ends: alone }
physics: { substeps: 5, control_rate_hz: 48, bullet: { mode: pyb_gnd_drag_dw, version: VERSION } }
action: { published: { kind: KIND } }
observation: { paper: { episode_secs: 5 } }
critic: observation
start: { position: { within: { low_m: [-0.2, -0.2, 0.1], high_m: [0.2, 0.2, 0.5] } }, speed_limit_m_per_s: 1 }
rewards: [ squared_distance: { weight: 1 }, increase_x_v2: { weight: 1 }, field_coverage: { weight: 1 } ]
episode_secs: 0.5
clock: { as_published: true }
success: { settle: { radius_m: 0.5, within_secs: 0.3 } }
";

#[test]
fn the_reference_s_physics_in_every_action_space() {
    let kinds = ["rpm", "dyn", "pid", "vel", "tun", "one_d_rpm", "one_d_dyn", "one_d_pid", "waypoint"];
    for (index, kind) in kinds.into_iter().enumerate() {
        let version = ["fork", "upstream", "sound"][index % 3];
        assert_deterministic(&BULLET.replace("VERSION", version).replace("KIND", kind), 55, &[TimeLimit]);
    }
}

#[test]
fn controllers_that_remember_the_episode_before() {
    let kept = BULLET.replace("VERSION", "fork").replace("kind: KIND", "kind: pid, controllers_persist: true");
    assert_deterministic(&kept, 55, &[TimeLimit]);
    let dyn_ = kept.replace("pyb_gnd_drag_dw", "dyn");
    assert_deterministic(&dyn_, 55, &[TimeLimit]);
}

/// A drone that sees what its sensors say, and past actions in another.
const SENSORS: &str = "
aviary: { goal_m: [0, 0, 1], room: { low_m: [-1, -1, 0], high_m: [1, 1, 2] } }
agents: { count: 2 }
physics: { control_rate_hz: 100 }
action: { published: { kind: vel } }
sensors: [ imu, flow, range: { directions: [front, up, left] }, barometer ]
observation: measured
start: { position: { within: { low_m: [-0.5, -0.5, 0.5], high_m: [0.5, 0.5, 1.5] } }, tilt_limit_deg: 30 }
rewards: [ proximity: { weight: 1, scale_m: 0.5 } ]
terminations: [ collision ]
episode_secs: 0.4
success: { settle: { radius_m: 0.5, within_secs: 0.3 } }
";

#[test]
fn sensors_and_past_actions() {
    assert_deterministic(SENSORS, 90, &[TimeLimit]);
    let past = SENSORS.replace("observation: measured", "observation: { kinematic: { past_actions: 5 } }");
    assert_deterministic(&past, 90, &[TimeLimit]);
}

#[test]
fn drawn_rooms_are_the_same_for_any_lanes_division_and_resumption() {
    let scenario = || crate::rooms::tests::checked(crate::rooms::tests::ROOMS).unwrap();
    let steps = 150;
    let reference = fly::<64>(&scenario(), &[(0, ENVIRONMENTS)], steps);
    let endings: Vec<Ending> = reference.episodes.iter().map(|episode| episode.ending).collect();
    assert!(endings.contains(&Collision) && endings.contains(&TimeLimit), "{endings:?}");
    assert!(reference == fly::<1>(&scenario(), &[(0, ENVIRONMENTS)], steps), "one lane");
    assert!(reference == fly::<8>(&scenario(), &[(0, 3), (3, 1), (4, 7)], steps), "divided");
    assert!(reference == fly_in_two::<64>(&scenario(), steps), "restored, 64 lanes");
    // In another process no room has been made yet.
    let mut first = Simulation::<8>::new(&scenario(), Seed(5), 0, ENVIRONMENTS);
    (0..80).for_each(|step| first.step(&actions_of(first.scenario(), 0, ENVIRONMENTS, step)));
    let mut resumed = Simulation::<8>::new(&scenario(), Seed(6), 0, 1);
    assert!(!resumed.restore(&first.save()));
    let mut resumed = Simulation::<8>::new(&scenario(), Seed(6), 3, ENVIRONMENTS);
    assert!(resumed.restore(&first.save()));
    for step in 80..120 {
        let actions = actions_of(&scenario(), 0, ENVIRONMENTS, step);
        first.step(&actions);
        resumed.step(&actions);
        assert_eq!(first.observations(), resumed.observations(), "step {step}");
    }
}
