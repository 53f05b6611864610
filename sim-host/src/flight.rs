//! Drones in an aviary, for software in the loop: the simulation itself, one environment wide.

use kestrel_core::observation::{ObservationLayout, PilotLayout};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::contact::{Arena, ContactReport, Motion, Touch};
use crate::scenario::{
    Agents, Clock, Contacts, CriticView, Goals, Place, Randomisation, Scenario, Start, StartPosition, Success,
};
use crate::seed::Seed;
use crate::sensor::SensorSuite;
use crate::simulation::Simulation;
use crate::world::{Cuboid, Floor, Pose, World};

/// Between two poses of a drone that is lowered to what is below \[m\].
const LOWERING_M: f64 = 0.01;

/// Points along each side of a region that are tried as launch sites.
const SITES: i32 = 9;

/// Between the launch sites of two drones \[m\]: more than twice a Crazyflie.
const APART_M: f64 = 0.3;

/// How far from an exact place launch sites are looked for, where several drones start \[m\].
const ASIDE_M: f64 = 2.0;

/// Time in which a drone that is put down comes to rest \[s\].
const SETTLING_SECS: f64 = 0.5;

/// What the drone sees, which nobody reads: the vehicle around it has the true state.
const UNREAD: ObservationLayout =
    ObservationLayout::Pilot(PilotLayout { position_scale_m: 1.0, velocity_scale: 1.0, body_rates_scale: 1.0 });

/// Drones that share an aviary and may meet there, advanced one control period at a time by their rotors.
///
/// The physics, walls, furniture and movable bodies are the scenario's; contacts are solved, those of drones too. Episodes
/// do not end, and a floor is below in every world, because vehicles take off from it.
#[derive(Clone, Debug)]
pub struct TeamFlight {
    simulation: Simulation<1, f64>,
    actions: Vec<f64>,
    states: Vec<State<f32>>,
    known_states: Vec<State<f32>>,
    periods: u64,
}

/// There are not so many places apart from each other from which a drone could take off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found places for {found} drones below where episodes begin, expected {expected}, 30 cm apart")]
pub struct NoRoom {
    /// How many there are.
    pub found: usize,
    /// How many are wanted.
    pub expected: usize,
}

impl TeamFlight {
    /// So many nominal drones in still air, at rest side by side on the floor or on something to land on, below where
    /// episodes begin.
    ///
    /// # Errors
    /// When there is no room for so many.
    pub fn landed(scenario: &Scenario, count: usize) -> Result<Self, NoRoom> {
        let sites = launch_sites(scenario, count)?;
        let mut flight = Self::new(scenario, &sites, &Randomisation::NONE, Seed(0));
        flight.settle();
        Ok(flight)
    }

    fn new(scenario: &Scenario, sites: &[Vector3<f64>], randomisation: &Randomisation, seed: Seed) -> Self {
        let scenario = &scenario.in_room(0);
        let places = sites.iter().map(|position| Place { position: *position, heading: 0.0, spread: 0.0 });
        let mut scenario = Scenario {
            agents: Agents { count: sites.len() as u32, ..Agents::ONE },
            goals: Goals::Fixed,
            start: Start {
                position: StartPosition::Exactly(places.collect()),
                heading_limit: 0.0,
                tilt_limit: 0.0,
                speed_limit: 0.0,
                body_rates_limit: 0.0,
            },
            randomisation: *randomisation,
            sensors: SensorSuite::none(),
            observation: UNREAD,
            camera: None,
            critic: CriticView::Observation,
            rewards: Vec::new(),
            terminations: Vec::new(),
            success: Success::Ending,
            clock: Clock::Elapsed,
            episode_secs: f32::INFINITY,
            ..scenario.clone()
        };
        scenario.aviary.world = on_floor(&scenario.aviary.world);
        scenario.physics.contacts = Contacts::Solved;
        let mut simulation = Simulation::new(&scenario, seed, 0, 1);
        let mut states = Vec::new();
        for row in 0..sites.len() {
            let state = State { rotor_speeds: [0.0; 4], ..simulation.state(row) };
            simulation.put(row, state);
            states.push(single(&state));
        }
        let actions = vec![0.0; scenario.action.len() * sites.len()];
        Self { actions, simulation, known_states: states.clone(), states, periods: 0 }
    }

    /// Lets the drones come to rest before the time begins.
    fn settle(&mut self) {
        let still = vec![[0.0; 4]; self.states.len()];
        for _ in 0..(SETTLING_SECS * self.scenario().physics.control_rate_hz) as u32 {
            self.step(&still);
        }
        self.periods = 0;
    }

    /// The true states.
    pub fn states(&self) -> &[State<f32>] {
        &self.states
    }

    /// The states that the drones know: older than the true ones where the scenario has a latency.
    pub fn known_states(&self) -> &[State<f32>] {
        &self.known_states
    }

    /// The scenario they fly in.
    pub fn scenario(&self) -> &Scenario {
        self.simulation.scenario()
    }

    /// Where the movable bodies are, in the order of the world.
    pub fn movables(&self) -> Vec<Pose> {
        self.simulation.movables(0)
    }

    /// Advances one control period with the rotor targets \[rad/s\] of each drone held.
    ///
    /// # Panics
    /// When there are not as many as drones.
    pub fn step(&mut self, rotor_targets: &[[f32; 4]]) {
        let targets: Vec<[f64; 4]> = rotor_targets.iter().map(|targets| targets.map(f64::from)).collect();
        self.simulation.step_with_rotor_speeds(&self.actions, &targets);
        for row in 0..self.states.len() {
            let state: State<f64> = self.simulation.state(row);
            let limited = state.tumbling_within_limit();
            if limited != state {
                self.simulation.put(row, limited);
            }
            self.states[row] = single(&limited);
            self.known_states[row] = single(&self.simulation.known_state(row));
        }
        self.periods += 1;
    }
}

/// A single drone in an aviary, as [`TeamFlight`].
#[derive(Clone, Debug)]
pub struct Flight(TeamFlight);

impl Flight {
    /// A nominal drone in still air, at rest on the floor or on something to land on, below where episodes begin.
    pub fn landed(scenario: &Scenario) -> Self {
        Self::at_rest(scenario, &Randomisation::NONE, Seed(0))
    }

    /// As [`Self::landed`], in the wind and with the drone of the episode that training draws with a seed.
    pub fn randomised(scenario: &Scenario, seed: Seed) -> Self {
        Self::at_rest(scenario, &scenario.randomisation, seed)
    }

    /// A nominal drone in still air at `position` \[m, world\]: level, still, rotors stopped.
    pub fn at(scenario: &Scenario, position: Vector3<f64>) -> Self {
        Self(TeamFlight::new(scenario, &[position], &Randomisation::NONE, Seed(0)))
    }

    fn at_rest(scenario: &Scenario, randomisation: &Randomisation, seed: Seed) -> Self {
        let mut flight = TeamFlight::new(scenario, &[launch_site(scenario)], randomisation, seed);
        flight.settle();
        Self(flight)
    }

    /// The true state.
    pub fn state(&self) -> &State<f32> {
        &self.0.states[0]
    }

    /// The state that the drone knows: older than the true one where the scenario has a latency.
    pub fn known_state(&self) -> &State<f32> {
        &self.0.known_states[0]
    }

    /// The scenario it flies in.
    pub fn scenario(&self) -> &Scenario {
        self.0.scenario()
    }

    /// Simulated time since the beginning \[s\].
    pub fn elapsed_secs(&self) -> f64 {
        self.0.periods as f64 / self.scenario().physics.control_rate_hz
    }

    /// Goes on from another state, as if nothing had happened before.
    pub fn put(&mut self, state: &State<f32>) {
        self.0.simulation.put(0, state.map(f64::from));
        (self.0.states[0], self.0.known_states[0]) = (*state, *state);
    }

    /// The wind that the drone meets \[m/s, world\].
    pub fn wind(&self) -> Vector3<f64> {
        self.0.simulation.wind(0)
    }

    /// Lets the drone meet another wind \[m/s, world\] from the next control period on.
    pub fn set_wind(&mut self, wind: Vector3<f64>) {
        self.0.simulation.set_wind(0, wind);
    }

    /// Lets the drone carry so much more \[kg\], at its centre of mass, from the next control period on; less, where it is negative.
    pub fn add_load(&mut self, mass: f64) {
        self.0.simulation.add_load(0, mass);
    }

    /// Where the movable bodies are, in the order of the world.
    pub fn movables(&self) -> Vec<Pose> {
        self.0.movables()
    }

    /// Advances one control period with rotor targets \[rad/s\] held.
    pub fn step(&mut self, rotor_targets: &[f32; 4]) {
        self.0.step(&[*rotor_targets]);
    }
}

fn single(state: &State<f64>) -> State<f32> {
    state.map(|value: f64| value as f32)
}

fn on_floor(world: &World) -> World {
    World { floor: Floor::Solid, ..world.clone() }
}

/// Just above the floor or something to land on \[m, world\], below the point nearest to the middle of where episodes begin
/// under which there is nothing else; if there is something everywhere, on that.
fn launch_site(scenario: &Scenario) -> Vector3<f64> {
    let mut starts = starts(scenario);
    if let StartPosition::Exactly(_) = scenario.start.position {
        starts.truncate(1);
    }
    let supports = supports(scenario, &starts);
    let best = supports.iter().find(|support| support.carries).or(supports.first());
    best.map_or(starts[0], |support| support.position)
}

/// So many of them \[m, world\], apart from each other, those nearest to the middle first, and on what is neither floor nor to land
/// on only when the others are not enough.
fn launch_sites(scenario: &Scenario, count: usize) -> Result<Vec<Vector3<f64>>, NoRoom> {
    let (carried, others): (Vec<_>, Vec<_>) =
        supports(scenario, &starts(scenario)).into_iter().partition(|support| support.carries);
    let mut sites: Vec<Vector3<f64>> = Vec::new();
    for support in carried.iter().chain(&others) {
        let is_apart = sites.iter().all(|site| (site - support.position).norm() > APART_M);
        if is_apart && sites.len() < count {
            sites.push(support.position);
        }
    }
    if sites.len() < count { Err(NoRoom { found: sites.len(), expected: count }) } else { Ok(sites) }
}

/// What is below points \[m, world\], where a drone can stand there.
fn supports(scenario: &Scenario, points: &[Vector3<f64>]) -> Vec<Support> {
    let world = on_floor(&scenario.aviary.world);
    let arena = Arena::new(&world, &scenario.airframe, ContactReport::Touch);
    let movables: Vec<Motion> = world.movables.iter().map(|body| Motion::at_rest(body.solid.pose)).collect();
    let airframe = &scenario.airframe;
    let rest_height = 0.5 * airframe.collision_height - airframe.collision_offset;
    let below = |start: &Vector3<f64>| Support::below(*start, rest_height, |pose| arena.touch(pose, &movables));
    points.iter().filter_map(below).collect()
}

/// Where a drone that is lowered stops.
struct Support {
    position: Vector3<f64>,
    /// Whether it is the floor or something to land on.
    carries: bool,
}

impl Support {
    /// What is below a point \[m, world\] for a drone whose middle is `rest_height` \[m\] above what carries it; none where
    /// it would touch something there already.
    fn below(point: Vector3<f64>, rest_height: f64, touch: impl Fn(&Pose) -> Touch) -> Option<Self> {
        let at = |height: f64| Vector3::new(point.x, point.y, height);
        let heights = (0..).map(|step| point.z - f64::from(step) * LOWERING_M);
        let is_free = |height: &f64| touch(&Pose::at(at(*height))) == Touch::default();
        let height = heights.take_while(is_free).last()?;
        let lowest = height - LOWERING_M;
        let carries = lowest < rest_height + LOWERING_M || touch(&Pose::at(at(lowest))).landing;
        Some(Self { position: at(height), carries })
    }
}

/// Points from which episodes begin \[m, world\], at least one, those nearest to the middle first; behind exact places those
/// around the first.
fn starts(scenario: &Scenario) -> Vec<Vector3<f64>> {
    match &scenario.start.position {
        StartPosition::AroundGoal { farthest_m, .. } => {
            let goal = scenario.aviary.goal;
            let aside = Vector3::new(*farthest_m, *farthest_m, 0.0);
            lattice(&Cuboid { low: goal - aside, high: goal + aside })
        }
        StartPosition::Within(region) => lattice(region),
        StartPosition::AlongWay(starts) => lattice(&starts.space.region),
        StartPosition::FreeWithin(space) => {
            let mut points = lattice(&space.region);
            points.retain(|point| space.holds(&point.cast()));
            points.push(space.refuge.cast());
            points
        }
        StartPosition::Exactly(places) => {
            let mut points: Vec<_> = places.iter().map(|place| place.position).collect();
            let aside = Vector3::new(ASIDE_M, ASIDE_M, 0.0);
            points.extend(lattice(&Cuboid { low: (points[0] - aside).cast(), high: (points[0] + aside).cast() }));
            points
        }
    }
}

/// Points evenly spread at half of the height of a box, the nearest to its middle first.
fn lattice(region: &Cuboid) -> Vec<Vector3<f64>> {
    let (low, high): (Vector3<f64>, Vector3<f64>) = (region.low.cast(), region.high.cast());
    let middle = (low + high) / 2.0;
    let half = SITES / 2;
    let point = |x: i32, y: i32| {
        let share = Vector3::new(f64::from(x), f64::from(y), 0.0) / f64::from(2 * half);
        middle + (high - low).component_mul(&share)
    };
    let mut points: Vec<_> = (-half..=half).flat_map(|x| (-half..=half).map(move |y| point(x, y))).collect();
    points.sort_by(|one, other| (one - middle).norm().total_cmp(&(other - middle).norm()));
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::hover;
    use crate::world::{Role, Solid};

    const REST_M: f32 = 0.0125;

    fn block(name: &str, low: [f64; 3], high: [f64; 3]) -> Solid {
        Solid::block(name, low.into(), high.into())
    }

    #[test]
    fn a_drone_without_thrust_falls_and_rests_on_the_floor() {
        let mut flight = Flight::at(&hover(), Vector3::new(0.2, 0.1, 0.5));
        for _ in 0..200 {
            flight.step(&[0.0; 4]);
        }
        let state = flight.state();
        assert!((state.position.z - REST_M).abs() < 2e-3, "{state:?}");
        assert!(state.velocity.norm() < 1e-2, "{state:?}");
    }

    #[test]
    fn a_drone_that_tumbles_for_minutes_stays_a_drone() {
        let mut flight = Flight::at(&hover(), Vector3::new(0.0, 0.0, 5_000.0));
        let limit = flight.scenario().airframe.rotor_speed_limit as f32;
        for _ in 0..3_000 {
            flight.step(&[limit, limit, 0.0, 0.0]);
            let State { position, velocity, body_rates, .. } = *flight.state();
            assert!(
                position.z.is_finite() && velocity.norm() < 100.0 && body_rates.norm() < 101.0,
                "{:?}",
                flight.state()
            );
        }
    }

    #[test]
    fn a_resting_drone_takes_off_when_thrust_exceeds_weight() {
        let scenario = hover();
        let hover_speed = scenario.airframe.hover_rotor_speed() as f32;
        let mut flight = Flight::landed(&scenario);
        for _ in 0..100 {
            flight.step(&[0.9 * hover_speed; 4]);
        }
        assert!(flight.state().position.z < 0.02);
        for _ in 0..100 {
            flight.step(&[1.1 * hover_speed; 4]);
        }
        assert!(flight.state().position.z > 0.05);
        assert!((flight.elapsed_secs() - 2.0).abs() < 1e-6);
    }

    #[test]
    fn a_solid_carries_the_drone_that_stands_on_it() {
        let mut scenario = hover();
        scenario.aviary.world.solids.push(block("table", [-1.0, -1.0, 0.0], [1.0, 1.0, 0.1]));
        let flight = Flight::landed(&scenario);
        assert!((flight.state().position.z - (0.1 + REST_M)).abs() < 2e-3, "{:?}", flight.state());
    }

    #[test]
    fn it_starts_beside_the_table_and_not_on_it_and_on_a_pad_where_one_is() {
        let mut scenario = hover();
        let region = Cuboid { low: Vector3::new(0.0, 0.0, 1.0), high: Vector3::new(2.0, 2.0, 1.2) };
        scenario.start.position = StartPosition::Within(region);
        scenario.aviary.world.solids.push(block("table", [0.7, 0.7, 0.6], [1.3, 1.3, 0.7]));
        let beside = Flight::landed(&scenario).state().position;
        assert!((beside.z - REST_M).abs() < 2e-3 && (beside.x - 1.0).abs().max((beside.y - 1.0).abs()) > 0.3);
        scenario.aviary.world.solids[0].role = Role::Landing;
        let on_it = Flight::landed(&scenario).state().position;
        assert!((on_it - Vector3::new(1.0, 1.0, 0.7 + REST_M)).norm() < 3e-3, "{on_it}");
    }

    #[test]
    fn drones_stand_apart_meet_and_do_not_pass_through_each_other() {
        let mut team = TeamFlight::landed(&hover(), 5).unwrap();
        let places: Vec<Vector3<f32>> = team.states().iter().map(|state| state.position).collect();
        for (index, place) in places.iter().enumerate() {
            assert!(
                (place.z - REST_M).abs() < 2e-3
                    && places[..index].iter().all(|other| (other - place).norm() > 0.3)
            );
        }
        // The first one is put above the second, falls on it, and stays above it or beside it.
        let above = State { position: places[1] + Vector3::new(0.0, 0.0, 0.5), ..team.states()[0] };
        team.simulation.put(0, above.map(f64::from));
        let mut nearest = f32::MAX;
        for _ in 0..100 {
            team.step(&[[0.0; 4]; 5]);
            let [first, second] = [0, 1].map(|drone| team.states()[drone].position);
            nearest = nearest.min((first - second).norm());
        }
        assert!((0.015..0.1).contains(&nearest), "{nearest} m");
        let error = TeamFlight::landed(&hover(), 5_000).unwrap_err();
        assert!(error.found > 5 && error.to_string().contains("expected 5000, 30 cm apart"), "{error}");
    }

    #[test]
    fn several_drones_stand_at_exact_places_then_around_them_and_on_a_field_that_covers_the_floor() {
        let mut scenario = hover();
        let place = |x: f64| Place { position: Vector3::new(x, 0.0, 0.3), heading: 0.0, spread: 0.0 };
        scenario.start.position = StartPosition::Exactly(vec![place(0.0), place(0.6)]);
        scenario.aviary.world.solids.push(block("field", [-3.0, -3.0, 0.0], [3.0, 3.0, 0.0625]));
        let team = TeamFlight::landed(&scenario, 4).unwrap();
        for (state, x) in team.states().iter().zip([0.0, 0.6]) {
            let place = Vector3::new(x, 0.0, 0.0625 + REST_M);
            assert!((state.position - place).norm() < 4e-3, "{}", state.position);
        }
        assert!(team.states()[2..].iter().all(|state| state.position.z < 0.08));
    }

    #[test]
    fn a_wall_stops_what_flies_against_it() {
        let mut scenario = hover();
        scenario.aviary.world.solids.push(block("wall", [0.5, -2.0, 0.0], [0.6, 2.0, 3.0]));
        let mut flight = Flight::at(&scenario, Vector3::new(0.0, 0.0, 1.0));
        let hover_speed = scenario.airframe.hover_rotor_speed() as f32;
        let arena = Arena::new(&scenario.aviary.world, &scenario.airframe, ContactReport::Touch);
        let mut touched = 0;
        for period in 0..300 {
            // A push of the rear rotors tilts it forward, towards the wall.
            let rear = if period < 3 { 1.1 } else { 1.0 };
            flight.step(&[hover_speed, rear * hover_speed, rear * hover_speed, hover_speed]);
            let position = flight.state().position;
            assert!(position.x < 0.5 || position.z > 3.0, "{position}");
            let attitude = flight.state().world_from_body.map(f64::from);
            let pose = Pose { position: position.cast(), world_from_body: attitude };
            touched += u32::from(arena.touch(&pose, &[]).obstacle);
        }
        assert!(touched > 0);
    }

    #[test]
    fn a_gust_pushes_as_long_as_it_blows() {
        let mut flight = Flight::landed(&hover());
        let hover_speed = flight.scenario().airframe.hover_rotor_speed() as f32;
        let fly = |flight: &mut Flight, wind: f64| {
            flight.set_wind(Vector3::new(0.0, wind, 0.0));
            let before = flight.state().velocity.y;
            (0..50).for_each(|_| flight.step(&[1.1 * hover_speed; 4]));
            flight.state().velocity.y - before
        };
        let [still, gust, after] = [0.0, 3.0, 0.0].map(|wind| fly(&mut flight, wind));
        assert!(still.abs() < 1e-3 && gust > 0.05 && after < 0.0, "{still} {gust} {after}");
        assert_eq!(flight.wind(), Vector3::zeros());
    }

    #[test]
    fn wind_is_felt_where_it_is_asked_for() {
        let scenario = hover();
        let mut still = Flight::landed(&scenario);
        let mut windy = Flight::randomised(&scenario, Seed(3));
        let hover_speed = scenario.airframe.hover_rotor_speed() as f32;
        for _ in 0..200 {
            still.step(&[1.1 * hover_speed; 4]);
            windy.step(&[1.1 * hover_speed; 4]);
        }
        let aside = |flight: &Flight| {
            let start = Flight::landed(&scenario).state().position;
            (flight.state().position - start).xy().norm()
        };
        assert!(aside(&still) < 1e-2 && aside(&windy) > 3e-2, "{} {}", aside(&still), aside(&windy));
    }
}
