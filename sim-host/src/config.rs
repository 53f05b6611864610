//! Scenarios as users write them in YAML, and their conversion to the checked [`Scenario`].
//!
//! Each type whose name ends in `Config` mirrors a part of the file: degrees, hertz, units in the keys. Its `check`
//! returns what the program runs, or says what is wrong on which line. A [`Document`] is the file itself.

mod agents;
mod airframe;
pub(crate) mod area;
mod aviary;
mod camera;
mod drawn;
mod estimate;
pub(crate) mod geometry;
mod mesh;
mod notation;
mod physics;
mod pilot;
mod policy;
mod sensor;
mod start;
mod success;
#[cfg(test)]
mod tests;
mod urdf;
mod vehicle;
mod world;

use std::sync::Arc;

use kestrel_config::{error, field};
use kestrel_core::airframe::{Airframe, FlightEffects};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use kestrel_config::{ConfigError, Field, Library, Limits, schema_of};

pub use agents::{AgentsConfig, CourseConfig, GoalsConfig};
pub use airframe::{
    AirframeConfig, AirframeNumbers, CollisionConfig, DownwashConfig, EffectsConfig, KnownAirframe, LayoutConfig,
    RotorNumbering, RotorOrderConfig, read_airframe,
};
pub use area::{AreaConfig, BoxConfig};
pub use aviary::{AviaryConfig, AviaryParts};
pub(crate) use world::{Placement, pillar_around, turned};

pub use camera::{CameraConfig, ChannelConfig, MountedCameraConfig, ReferenceCameraConfig};
pub use drawn::{
    CorridorsConfig, DrawnConfig, ForestConfig, FurnishedRoomsConfig, GeneratorConfig, ModelConfig,
    MovedFurnitureConfig, RaceCoursesConfig, WorldsConfig,
};
pub use estimate::{DeviationConfig, EstimateConfig, LatencyConfig, OutagesConfig};
pub use notation::{Document, DroneNotations};
pub use physics::{
    BulletConfig, DragFrameConfig, DynReportConfig, IntegratorConfig, ModeConfig, PhysicsConfig, QuirksConfig,
    VersionConfig,
};
pub use pilot::{
    ActionConfig, KinematicConfig, ObservationConfig, PilotConfig, ReferenceActionConfig,
    ReferenceActionKindConfig, ReferenceControllerConfig, ReferenceObservationConfig, ReferencePrecisionConfig,
    RotorSpeedsConfig, ThrustBodyRatesConfig, ThrustTorquesConfig, VelocityConfig,
};
pub use policy::policy_bytes;
pub use sensor::{
    AccelerometerConfig, BarometerConfig, BeamConfig, DirectionConfig, FlowConfig, GatesAheadConfig,
    GyroscopeConfig, ImuConfig, MatesConfig, RangeConfig, ScanConfig, ScanRingConfig, SensorConfig, WayConfig,
};
pub use start::{AirframesConfig, RandomisationConfig, StartConfig, StartPoseConfig, StartPositionConfig};
pub use success::{ClockConfig, SuccessConfig};
pub use vehicle::VehicleConfig;
pub use world::{
    ConeConfig, CylinderConfig, FurnitureConfig, GateConfig, HullConfig, MeshConfig, MovableConfig, RoomConfig,
    SolidConfig, SuperellipsoidConfig, TurnedBoxConfig, VisualConfig,
};

use crate::contact::{DistanceField, race_line};
use crate::reward::RewardTerm;
use crate::rooms::{CLEARANCE_M, Rooms, Ways};
use crate::scenario::{Aviary, CriticView, Goals, Preset, Scenario, TeamSuccess};
use crate::term::{GoalKind, RewardTask, RuleTask};
use crate::termination::Termination;
use crate::world::{Cuboid, Drive, World};

/// Default of [`ScenarioConfig::episode_secs`].
const EPISODE_SECS: f64 = 8.0;

/// Shorter episodes teach nothing, longer ones are several tasks.
pub const EPISODE_LIMITS: Limits = Limits::from(0.1, 600.0, "s");

/// One task: where, with what, from where, for what, until when.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioConfig {
    /// The place: the goal, the floor, walls and obstacles.
    pub aviary: AviaryConfig,
    /// How the goal differs between drones or moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goals: Option<GoalsConfig>,
    /// Who flies there together.
    #[serde(default)]
    pub agents: AgentsConfig,
    /// The drone.
    #[serde(default)]
    pub vehicle: VehicleConfig,
    /// How time advances.
    #[serde(default)]
    pub physics: PhysicsConfig,
    /// What the policy commands.
    #[serde(default)]
    pub action: ActionConfig,
    /// What the drone measures, for the observations `measured` and `pilot_measured`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<SensorConfig>,
    /// What the policy sees.
    #[serde(default)]
    pub observation: ObservationConfig,
    /// A camera, whose images the policy sees beside that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
    /// What the critic sees while training.
    #[serde(default)]
    pub critic: CriticView,
    /// How episodes begin.
    pub start: StartConfig,
    /// How late the drone knows its state, and its motors their command.
    #[serde(default, skip_serializing_if = "LatencyConfig::is_none")]
    pub latency: LatencyConfig,
    /// How wrongly the drone knows its state.
    #[serde(default, skip_serializing_if = "EstimateConfig::is_none")]
    pub estimate: EstimateConfig,
    /// What differs from episode to episode.
    #[serde(default)]
    pub randomisation: RandomisationConfig,
    /// What is rewarded: a sum of weighted terms.
    pub rewards: Vec<RewardTerm>,
    /// What ends an episode in failure.
    #[serde(default)]
    pub terminations: Vec<Termination>,
    /// Time after which an episode ends, which is no failure.
    #[serde(default = "episode_secs")]
    pub episode_secs: f64,
    /// How that time is counted and what its end means.
    #[serde(default)]
    pub clock: ClockConfig,
    /// What counts as success.
    pub success: SuccessConfig,
}

fn episode_secs() -> f64 {
    EPISODE_SECS
}

impl Scenario {
    /// The scenario called `name` of a document that holds nothing else.
    ///
    /// # Errors
    /// The first value that is not what its key asks for, is out of range or contradicts another.
    pub fn of(name: &str, document: &Document) -> Result<Self, ConfigError> {
        document.decode::<ScenarioConfig>()?.check(name, &document.root())
    }
}

impl ScenarioConfig {
    /// The scenario called `name`; `field` is the place of this configuration in its document.
    ///
    /// # Errors
    /// The first value that is out of range or contradicts another.
    pub fn check(&self, name: &str, field: &Field<'_>) -> Result<Scenario, ConfigError> {
        let airframe = self.vehicle.check(&field.at("vehicle"))?;
        let mut physics = self.physics.check(&field.at("physics"))?;
        let action = self.action.check(&airframe, &field.at("action"))?;
        let sensors = SensorConfig::check_all(&self.sensors, 1.0 / physics.control_rate_hz, &field.at("sensors"))?;
        let observation = self.observation.check(action.len(), sensors.len(), &field.at("observation"))?;
        let camera =
            self.camera.as_ref().map(|camera| camera.check(&airframe, &field.at("camera"))).transpose()?;
        let drawn = self.drawn_rooms(&airframe, field)?;
        let mut aviary = match &drawn {
            None => self.aviary.check(&airframe, &field.at("aviary"))?,
            Some(rooms) => rooms.room(0).aviary.clone(),
        };
        let agents = self.agents.check(&aviary.world, &field.at("agents"))?;
        self.check_team(agents.count, field)?;
        let goals = self.check_goals(agents.count, drawn.as_deref(), &aviary.world, field)?;
        self.line_up_gates(&mut aviary, &goals, field)?;
        self.check_carried(&aviary.world, &goals, field)?;
        let task = rule_task(&aviary, drawn.as_deref(), &goals);
        let terminations = Termination::check_all(&self.terminations, &task, &field.at("terminations"))?;
        self.physics.settle_contacts(&mut physics, &terminations);
        self.check_drawn(&physics, field)?;
        let first_goals = goals.first(&aviary.goal, agents.count);
        let in_start = field.at("start");
        let start = match &drawn {
            None => self.start.check(&aviary, &airframe, &terminations, &first_goals, &in_start)?,
            Some(rooms) => self.start.check_in_rooms(rooms, &airframe, &terminations, &first_goals, &in_start)?,
        };
        self.check_randomisation(physics.preset, &airframe, field)?;
        let same = || Ways::Same(ways_of(&aviary, &airframe, &terminations));
        let ways = drawn.as_ref().map_or_else(same, |rooms| Ways::Drawn(Arc::clone(rooms)));
        let kind = if goals == Goals::Fixed { GoalKind::OnePlace } else { GoalKind::Several };
        let task = RewardTask { goals: kind, contacts: physics.contacts, ways, own_way: sensors.finds_way() };
        let (clock, time_limit) = self.clock.check();
        Ok(Scenario {
            name: name.to_owned(),
            critic: self.critic,
            latency: self.latency.check(1.0 / physics.control_rate_hz, &field.at("latency"))?,
            estimate: self.estimate.check(&field.at("estimate"))?,
            randomisation: self.randomisation.check(&field.at("randomisation"))?,
            rewards: RewardTerm::check_all(&self.rewards, &task, &field.at("rewards"))?,
            episode_secs: field.at("episode_secs").number(self.episode_secs, &EPISODE_LIMITS)?,
            success: self.success.check(&aviary, self.episode_secs, &terminations, &field.at("success"))?,
            goals,
            agents,
            sensors,
            clock,
            time_limit,
            aviary,
            drawn,
            airframe,
            physics,
            gyro_cutoff_hz: self.action.check_gyro(&physics, &field.at("action"))?,
            action,
            observation,
            camera,
            start,
            terminations,
        })
    }

    /// How the goals of so many drones differ or move, and that what they are told goes with it.
    fn check_goals(
        &self,
        drones: u32,
        drawn: Option<&Rooms>,
        world: &World,
        field: &Field<'_>,
    ) -> Result<Goals, ConfigError> {
        let goals = match &self.goals {
            _ if drawn.is_some_and(Rooms::is_race) => Goals::Gates,
            Some(goals) => goals.check(drones, world, &field.at("goals"))?,
            None => Goals::Fixed,
        };
        self.check_told(&goals, field)?;
        Ok(goals)
    }

    /// Puts gates into the order in which they are passed; where they are no goals, they only stand there.
    fn line_up_gates(&self, aviary: &mut Aviary, goals: &Goals, field: &Field<'_>) -> Result<(), ConfigError> {
        if let Some(GoalsConfig::Gates(course)) = &self.goals {
            aviary.gates = course.check(&aviary.gates, &field.at("goals").at("gates"))?;
            aviary.goal = aviary.gates[0].center.cast();
            if aviary.routes.is_empty() {
                let line = race_line(&aviary.world, None, &aviary.gates, CLEARANCE_M).unwrap_or_default();
                aviary.routes = vec![line.iter().map(|point| point.cast()).collect()];
            }
        } else if *goals != Goals::Gates {
            aviary.gates.clear();
        }
        Ok(())
    }

    /// Refuses bodies that go with a goal that stays, or in the physics of Bullet, whose bodies are all pushed.
    fn check_carried(&self, world: &World, goals: &Goals, field: &Field<'_>) -> Result<(), ConfigError> {
        let field = field.at("aviary").at("carried");
        match world.movables.iter().find(|body| body.drive == Drive::Carried) {
            Some(body) if !goals.is_moving() => {
                let found = format!("`{}`, which goes with the goal, and a goal that stays", body.solid.name);
                Err(field.reject(found, "`goals` that move: `line`, `wave` or `trajectory`"))
            }
            Some(_) if self.physics.bullet.is_some() => {
                Err(field.reject("bodies that are carried in `physics.bullet`", "none, or the physics `clean`"))
            }
            Some(_) | None => Ok(()),
        }
    }

    /// Refuses a sensor that sees more team mates than there are, and a success of all that ends the episode of the first.
    fn check_team(&self, drones: u32, field: &Field<'_>) -> Result<(), ConfigError> {
        if let Some(SensorConfig::Mates(mates)) = self.sensors.last()
            && mates.nearest >= u64::from(drones)
        {
            let field = field.at("sensors").at(self.sensors.len() - 1).at("mates").at("nearest");
            return Err(field.refuse(mates.nearest, format!("fewer than the {drones} drones of `agents`")));
        }
        match (self.agents.success, &self.success) {
            (TeamSuccess::Own, _) | (_, SuccessConfig::Settle { .. } | SuccessConfig::Visit { .. }) => Ok(()),
            (TeamSuccess::All, _) => {
                let found = "`all` beside a success that ends the episode of the first";
                Err(field
                    .at("agents")
                    .at("success")
                    .reject(found, "`settle` or `visit` under `success`, or `own`"))
            }
        }
    }

    /// Refuses a look at the way ahead of a goal that follows none, and at gates that are none.
    fn check_told(&self, goals: &Goals, field: &Field<'_>) -> Result<(), ConfigError> {
        let refuse = |found: &str, expected: &str| {
            Err(field.at("sensors").at(self.sensors.len() - 1).reject(found, expected))
        };
        match self.sensors.last() {
            Some(SensorConfig::Path(_)) if goals.trajectories().is_none() => {
                refuse("`path` without a way", "a `trajectory` under `goals`")
            }
            Some(SensorConfig::Way(_))
                if !self
                    .sensors
                    .iter()
                    .any(|sensor| matches!(sensor, SensorConfig::Scan(_) | SensorConfig::Tof(_))) =>
            {
                refuse("`way` without a sensor that meets what is in it", "a `scan` or a `tof` before it")
            }
            Some(SensorConfig::Gates(_)) if *goals != Goals::Gates => {
                refuse("`gates` without a course", "`gates` under `goals`")
            }
            Some(_) | None => Ok(()),
        }
    }

    /// Refuses to draw what these physics or this airframe have not.
    fn check_randomisation(
        &self,
        preset: Preset,
        airframe: &Airframe,
        field: &Field<'_>,
    ) -> Result<(), ConfigError> {
        self.check_quiet_air(preset, field)?;
        self.check_airframes(field)?;
        self.check_effects(airframe, field)
    }

    /// Refuses randomisation in the reference's physics, which has none.
    fn check_quiet_air(&self, preset: Preset, field: &Field<'_>) -> Result<(), ConfigError> {
        let drawn = self.randomisation;
        let spreads = [
            ("mass_fraction", drawn.mass_fraction),
            ("inertia_fraction", drawn.inertia_fraction),
            ("thrust_fraction", drawn.thrust_fraction),
            ("rotor_lag_fraction", drawn.rotor_lag_fraction),
            ("torque_fraction", drawn.torque_fraction),
            ("effects_fraction", drawn.effects_fraction),
            ("wind_speed_m_per_s", drawn.wind_speed_m_per_s),
        ];
        if matches!(preset, Preset::Clean { .. }) {
            return Ok(());
        }
        let because = "because the physics `bullet` is the same in every episode";
        let field = field.at("randomisation");
        if let Some((key, value)) = spreads.into_iter().find(|(_, spread)| *spread != 0.0) {
            return Err(field.at(key).refuse(value, format!("0, {because}")));
        }
        let shares = [("rotor_lag_share", drawn.rotor_lag_share), ("torque_share", drawn.torque_share)];
        match shares.into_iter().find(|(_, share)| *share != [1.0; 2]) {
            None => Ok(()),
            Some((key, share)) => Err(field.at(key).reject(format!("{share:?}"), format!("[1, 1], {because}"))),
        }
    }

    /// Refuses other drones where their actions are those of one, or the air is not free.
    fn check_airframes(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        let Some(_) = self.randomisation.airframes else { return Ok(()) };
        if !matches!(self.action, ActionConfig::ThrustTorques(_)) {
            let expected =
                "`thrust_torques`, the actions that any drone understands, beside `randomisation.airframes`";
            return Err(field.at("action").reject("other actions", expected));
        }
        if self.physics.ground_effect || self.physics.ceiling_effect_m.is_some() {
            let expected = "neither beside `randomisation.airframes`, whose rotors lie elsewhere in every episode";
            return Err(field.at("physics").reject("a ground effect or a ceiling", expected));
        }
        Ok(())
    }

    /// Refuses what only an airframe with effects can draw.
    fn check_effects(&self, airframe: &Airframe, field: &Field<'_>) -> Result<(), ConfigError> {
        if airframe.effects != FlightEffects::NONE {
            return Ok(());
        }
        let expected = |value: &str| format!("{value}, because the airframe has no `effects`");
        let field = field.at("randomisation");
        if self.randomisation.motor_fraction != 0.0 {
            return Err(field.at("motor_fraction").refuse(self.randomisation.motor_fraction, expected("0")));
        }
        let shares = [
            ("weak_motor_share", self.randomisation.weak_motor_share),
            ("battery_share", self.randomisation.battery_share),
            ("rate_damping_share", self.randomisation.rate_damping_share),
        ];
        match shares.into_iter().find(|(_, share)| *share != [1.0; 2]) {
            None => Ok(()),
            Some((key, share)) => Err(field.at(key).reject(format!("{share:?}"), expected("[1, 1]"))),
        }
    }
}

/// What terminations are checked against.
fn rule_task(aviary: &Aviary, drawn: Option<&Rooms>, goals: &Goals) -> RuleTask {
    RuleTask { goals: drawn.map_or(at(aviary.goal), Rooms::goals), is_race: *goals == Goals::Gates }
}

/// The box of one point.
fn at(point: nalgebra::Vector3<f32>) -> Cuboid {
    Cuboid { low: point, high: point }
}

/// The ways to the goal inside the bounds of the terminations, or where there are none within reach of what stands there.
fn ways_of(aviary: &Aviary, airframe: &Airframe, terminations: &[Termination]) -> Arc<DistanceField> {
    let bounds = terminations.iter().find_map(Termination::bounds);
    let around_goal = Cuboid { low: aviary.goal.add_scalar(-1.0), high: aviary.goal.add_scalar(1.0) };
    let all =
        |whole: Cuboid, part: Cuboid| Cuboid { low: whole.low.inf(&part.low), high: whole.high.sup(&part.high) };
    let bounds = bounds.unwrap_or_else(|| aviary.world.bounds().into_iter().fold(around_goal, all));
    DistanceField::shared(&aviary.world, &aviary.goal, bounds, airframe.collision_radius)
}
