//! A drone that a policy flies to wherever the mouse points.

use kestrel_core::pilot::Pilot;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_draw::live::{LiveScene, Picked};
use kestrel_draw::recorded_flight::Placement;
use kestrel_export::policy::Policy;
use kestrel_onboard::autopilot::leash_m;
use kestrel_onboard::goal::MovingGoal;
use kestrel_sim::config::ConfigError;
use kestrel_sim::flight::Flight;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::world::{Floor, Pose, World};
use nalgebra::Vector3;
use wasm_bindgen::Clamped;
use wasm_bindgen::prelude::*;

use crate::furniture::{piece, shift};
use crate::policy::WebPolicy;
use crate::stage::{Look, Stage, telemetry};

/// Height above its launch site at which it hovers first \[m\].
const FIRST_HEIGHT: f32 = 1.0;

/// Speed of the goal on its way to where the mouse points \[m/s\].
const GOAL_SPEED: f32 = 1.5;

/// Least and greatest height of the goal \[m\].
const HEIGHTS: [f32; 2] = [0.1, 3.0];

/// How far from its launch site the goal may be \[m\].
const FARTHEST: f32 = 12.0;

/// What a push gives it: velocity \[m/s\], and rates of roll and pitch \[rad/s\].
const PUSH_SPEED: f32 = 1.5;
const PUSH_RATE: f32 = 6.0;

/// Least and greatest share of its nominal mass.
const MASS_SHARES: [f64; 2] = [0.5, 1.5];

/// Greatest wind along each axis \[m/s\].
const WIND_LIMIT: f64 = 5.0;

/// Why a policy does not fly freely.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FreeFlightError {
    /// The task is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// It needs more than a goal.
    #[error("the policy \"{0}\" sees what only its task has: expected one that flies to a goal")]
    Bound(String),
    /// It was trained at another pace.
    #[error("the policy \"{policy}\" acts every {found_secs} s, expected every {expected_secs} s")]
    ControlPeriod {
        /// Name of its experiment.
        policy: String,
        /// Of the policy \[s\].
        found_secs: f32,
        /// Of the task \[s\].
        expected_secs: f32,
    },
}

/// One drone in the world of a task, with walls and furniture that stop it.
#[wasm_bindgen]
#[derive(Debug)]
pub struct FreeFlight {
    policy: WebPolicy,
    pilot: Pilot<'static>,
    /// The drone, and the world as it is now.
    scenario: Scenario,
    /// As it was at first.
    world: World,
    mass_share: f64,
    flight: Flight,
    /// Before the last control period.
    before: State<f32>,
    goal: MovingGoal,
    grabbed: Option<Grabbed>,
    stage: Stage,
}

/// A piece of furniture in the hand.
#[derive(Clone, Debug)]
struct Grabbed {
    parts: Vec<usize>,
    /// Where the hand is \[m, world\].
    hand: Vector3<f64>,
}

#[wasm_bindgen]
impl FreeFlight {
    /// The drone of the policy's task, on the floor below where episodes of `world` begin. Both are YAML with resolved imports.
    ///
    /// # Errors
    /// When a task is wrong, or the policy sees what only its task has.
    #[wasm_bindgen(constructor)]
    pub fn new(policy: &WebPolicy, task: &str, world: &str) -> Result<Self, JsError> {
        Ok(Self::begin(policy, task, world)?)
    }

    /// From one control period to the next \[s\].
    #[wasm_bindgen(getter)]
    pub fn control_secs(&self) -> f32 {
        self.scenario.physics.control_secs()
    }

    /// Flies one control period.
    pub fn step(&mut self) {
        let secs = self.control_secs();
        let leash = leash_m(&self.policy.file().metadata().observation);
        self.goal.advance(&self.flight.state().position, leash, secs);
        let setpoint = Setpoint::at(self.goal.position());
        let targets = self.pilot.tick_towards(&[], self.flight.known_state(), &setpoint);
        self.before = *self.flight.state();
        self.flight.step(&targets);
        let place = self.flight.state().position.cast();
        self.stage.follow(std::iter::once(place));
    }

    /// Colours of the picture, `share` of a control period after the one before the last.
    pub fn draw(&mut self, share: f32, look: &Look) -> Clamped<Vec<u8>> {
        self.stage.scene.show_goals(&[self.goal.target().cast()]);
        let pose = between(&self.before, self.flight.state(), share);
        Clamped(self.stage.draw(&[pose], &self.flight.movables(), look))
    }

    /// The way of the drone in the last picture \[px\]: x and y of each point, NaN where it is hidden.
    pub fn trail(&self) -> Vec<f32> {
        self.stage.trail(0)
    }

    /// Where the floor below the drone is in the last picture \[px\], NaN where it is hidden.
    pub fn shadow(&self) -> Vec<f32> {
        let place: Vector3<f64> = self.flight.state().position.cast();
        self.stage.point(Vector3::new(place.x, place.y, 0.0)).into()
    }

    /// What is under the mouse: `goal`, `drone`, `furniture` or nothing. Furniture is in the hand from now on.
    pub fn grab(&mut self, column: usize, row: usize) -> String {
        let picked = self.stage.scene.pick([column, row]);
        let found = match picked {
            Picked::Nothing => "",
            Picked::Goal(_) => "goal",
            Picked::Drone(_) => "drone",
            Picked::Solid(part) => {
                let parts = piece(&self.scenario.aviary.world, part);
                let hand = self.stage.scene.at_height([column as f64, row as f64], 0.0);
                self.grabbed = parts.zip(hand).map(|(parts, hand)| Grabbed { parts, hand });
                if self.grabbed.is_some() { "furniture" } else { "" }
            }
        };
        found.to_owned()
    }

    /// Moves the furniture in the hand with the mouse.
    pub fn drag(&mut self, column: f64, row: f64) {
        let Some(to) = self.stage.scene.at_height([column, row], 0.0) else { return };
        let Some(Grabbed { parts, hand }) = &mut self.grabbed else { return };
        shift(&mut self.scenario.aviary.world, parts, to - *hand);
        *hand = to;
        self.rebuild();
    }

    /// Puts down what is in the hand.
    pub fn release(&mut self) {
        self.grabbed = None;
    }

    /// The goal goes where the mouse points, at its height.
    pub fn point_at(&mut self, column: f64, row: f64) {
        let target = self.goal.target();
        if let Some(place) = self.stage.scene.at_height([column, row], f64::from(target.z)) {
            self.head_for(Vector3::new(place.x as f32, place.y as f32, target.z));
        }
    }

    /// The goal goes up or down \[m\].
    pub fn raise(&mut self, metres: f32) {
        let target = self.goal.target();
        self.head_for(target + metres * Vector3::z());
    }

    /// Where the goal goes \[m, world\].
    #[wasm_bindgen(getter)]
    pub fn goal(&self) -> Vec<f32> {
        self.goal.target().as_slice().to_vec()
    }

    /// Pushes the drone away from whoever looks at that pixel.
    pub fn push(&mut self, column: f64, row: f64) {
        let ray: Vector3<f32> = self.stage.scene.ray([column, row]).normalize().cast();
        let state = self.flight.state();
        let aside = state.world_from_body.rotate_inverse(ray.cross(&Vector3::z()));
        let pushed = State {
            velocity: state.velocity + PUSH_SPEED * ray,
            body_rates: state.body_rates - PUSH_RATE * aside,
            ..*state
        };
        self.flight.put(&pushed);
    }

    /// The wind \[m/s, world\] from now on, limited to 5 m/s along each axis.
    pub fn set_wind(&mut self, x: f64, y: f64) {
        let limited = |speed: f64| if speed.is_nan() { 0.0 } else { speed.clamp(-WIND_LIMIT, WIND_LIMIT) };
        self.flight.set_wind(Vector3::new(limited(x), limited(y), 0.0));
    }

    /// The drone weighs that share of its nominal mass from now on, 0.5 to 1.5.
    pub fn set_mass(&mut self, share: f64) {
        self.mass_share = if share.is_nan() { 1.0 } else { share.clamp(MASS_SHARES[0], MASS_SHARES[1]) };
        self.rebuild();
    }

    /// Its mass \[kg\].
    #[wasm_bindgen(getter)]
    pub fn mass(&self) -> f64 {
        self.scenario.airframe.mass * self.mass_share
    }

    /// Starts from the floor again, the furniture as it was.
    pub fn reset(&mut self) {
        self.scenario.aviary.world = self.world.clone();
        self.grabbed = None;
        let wind = self.flight.wind();
        self.flight = Flight::landed(&self.loaded());
        self.flight.set_wind(wind);
        self.before = *self.flight.state();
        self.pilot.reset();
        self.goal = first_goal(self.flight.state());
        self.stage = stage(&self.scenario);
    }

    /// Position \[m, world\], speed \[m/s\], tilt \[rad\], distance to the goal \[m\], rotor speeds as shares of the greatest.
    pub fn telemetry(&self) -> Vec<f32> {
        telemetry(self.flight.state(), &self.goal.target(), &self.scenario.airframe)
    }

    /// What each layer of the network read last, as shares of one, layer after layer, and the action.
    pub fn activations(&self) -> Vec<f32> {
        self.policy.activations(self.pilot.last_observation())
    }
}

impl FreeFlight {
    /// As [`Self::new`].
    ///
    /// # Errors
    /// When a task is wrong, or the policy sees what only its task has.
    pub(crate) fn begin(policy: &WebPolicy, task: &str, world: &str) -> Result<Self, FreeFlightError> {
        let (Policy::Blind(file), true) = (policy.file(), policy.is_free()) else {
            return Err(FreeFlightError::Bound(policy.name()));
        };
        let (task, place) = (crate::experiment(task)?.scenario, crate::experiment(world)?.scenario.in_room(0));
        let (found_secs, expected_secs) = (file.metadata().control_period_secs, task.physics.control_secs());
        if !policy.file().keeps_pace(expected_secs) {
            return Err(FreeFlightError::ControlPeriod { policy: policy.name(), found_secs, expected_secs });
        }
        let mut scenario = Scenario {
            airframe: task.airframe,
            physics: task.physics,
            action: task.action,
            gyro_cutoff_hz: task.gyro_cutoff_hz,
            latency: task.latency,
            ..place
        };
        scenario.aviary.world.floor = Floor::Solid;
        let flight = Flight::landed(&scenario);
        let state = *flight.state();
        Ok(Self {
            policy: *policy,
            pilot: Pilot::new((**file).clone()),
            world: scenario.aviary.world.clone(),
            mass_share: 1.0,
            before: state,
            goal: first_goal(&state),
            grabbed: None,
            stage: stage(&scenario),
            flight,
            scenario,
        })
    }

    fn head_for(&mut self, target: Vector3<f32>) {
        let limits = [-FARTHEST, FARTHEST];
        let [x, y] = [target.x, target.y].map(|place| place.clamp(limits[0], limits[1]));
        self.goal.head_for(Vector3::new(x, y, target.z.clamp(HEIGHTS[0], HEIGHTS[1])), GOAL_SPEED);
    }

    /// The task with the load.
    fn loaded(&self) -> Scenario {
        let mut scenario = self.scenario.clone();
        scenario.airframe.mass *= self.mass_share;
        scenario
    }

    /// Goes on in the world as it is now, with the drone as it is now.
    fn rebuild(&mut self) {
        let (state, wind) = (*self.flight.state(), self.flight.wind());
        self.flight = Flight::at(&self.loaded(), state.position.cast());
        self.flight.put(&state);
        self.flight.set_wind(wind);
        self.stage.scene = LiveScene::new(&self.scenario.aviary.world, &self.scenario.airframe, 1);
    }
}

fn stage(scenario: &Scenario) -> Stage {
    Stage::new(LiveScene::new(&scenario.aviary.world, &scenario.airframe, 1), 1)
}

fn first_goal(state: &State<f32>) -> MovingGoal {
    let mut goal = MovingGoal::at(state.position, 0.0);
    goal.head_for(state.position + FIRST_HEIGHT * Vector3::z(), GOAL_SPEED);
    goal
}

/// A pose between two states.
pub(crate) fn between(before: &State<f32>, after: &State<f32>, share: f32) -> Pose {
    let [before, after] =
        [before, after].map(|state| Placement { position: state.position, attitude: state.world_from_body });
    before.towards(&after, if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) }).pose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{pilot, task};

    const LOOK: [usize; 2] = [160, 90];

    fn begun(world: &str) -> FreeFlight {
        FreeFlight::begin(&pilot("hover"), &task("hover"), &task(world)).unwrap()
    }

    fn fly(flight: &mut FreeFlight, secs: f32) -> Vec<f32> {
        (0..(secs / flight.control_secs()) as usize).for_each(|_| flight.step());
        flight.telemetry()
    }

    fn look(flight: &mut FreeFlight) -> usize {
        let [columns, rows] = LOOK;
        flight.draw(1.0, &Look { columns, rows, ..Look::new(0.6, 0.35, 4.0) }).len()
    }

    #[test]
    fn it_takes_off_goes_where_the_mouse_points_and_bears_a_push() {
        let mut flight = begun("hover");
        assert!(fly(&mut flight, 5.0)[5] < 0.1, "{:?}", flight.telemetry());
        assert_eq!(look(&mut flight), 4 * LOOK[0] * LOOK[1]);
        let before = flight.goal();
        flight.point_at(30.0, 60.0);
        assert!(flight.goal()[..2] != before[..2] && flight.goal()[2] == before[2]);
        assert!(fly(&mut flight, 6.0)[5] < 0.1, "{:?}", flight.telemetry());
        flight.push(80.0, 45.0);
        assert!(flight.telemetry()[3] > 1.0);
        assert!(fly(&mut flight, 6.0)[5] < 0.1, "{:?}", flight.telemetry());
        flight.set_mass(1.2);
        flight.set_wind(f64::NAN, 1.0);
        assert!(fly(&mut flight, 6.0)[5] < 0.3, "{:?}", flight.telemetry());
        assert!((flight.mass() / flight.scenario.airframe.mass - 1.2).abs() < 1e-12);
        flight.reset();
        assert!(flight.telemetry()[2] < 0.05);
    }

    #[test]
    fn furniture_goes_with_the_hand_and_back_at_a_reset() {
        let mut flight = begun("room-0");
        fly(&mut flight, 2.0);
        look(&mut flight);
        let pixels = (0..LOOK[0]).flat_map(|column| (0..LOOK[1]).map(move |row| [column, row]));
        let held = pixels.clone().find(|[column, row]| flight.grab(*column, *row) == "furniture").unwrap();
        assert!(pixels.clone().any(|[column, row]| flight.grab(column, row) == "drone"));
        flight.grab(held[0], held[1]);
        let moved = |flight: &FreeFlight| {
            let solids = flight.scenario.aviary.world.solids.iter().zip(&flight.world.solids);
            solids.filter(|(now, first)| now.pose != first.pose).count()
        };
        flight.drag(held[0] as f64 + 10.0, held[1] as f64);
        assert!(moved(&flight) > 0);
        flight.release();
        let before = moved(&flight);
        flight.drag(0.0, 89.0);
        assert_eq!(moved(&flight), before, "the hand is empty");
        flight.reset();
        assert_eq!(moved(&flight), 0);
    }

    #[test]
    fn a_policy_flies_at_the_pace_of_its_training() {
        let refused = FreeFlight::begin(&pilot("hover"), &task("swarm"), &task("hover")).map(drop).unwrap_err();
        assert!(refused.to_string().starts_with("the policy \"hover\" acts every 0.02 s, expected"), "{refused}");
    }

    #[test]
    fn whoever_sees_beams_does_not_fly_freely() {
        let refused = FreeFlight::begin(&pilot("room-1"), &task("room-1"), &task("hover")).map(drop).unwrap_err();
        assert!(refused.to_string().contains("sees what only its task has"), "{refused}");
    }
}
