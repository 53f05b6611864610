//! The place: goal, floor, walls, obstacles; the schema of a world file and of a task's `aviary`.

use std::path::Path;

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Document;
use super::drawn::DrawnConfig;
use super::error::ConfigError;
use super::field::Field;
use super::geometry::holds;
use super::world::{FurnitureConfig, GateConfig, MovableConfig, RoomConfig, SolidConfig, pillar};
use crate::course::Gate;
use crate::scenario::Aviary;
use crate::world::{Drive, Floor, Movable, Role, Solid, World};

/// Most solids and movables: contacts look at all of them near a drone.
const SOLIDS_LIMIT: usize = 1024;

/// One place with obstacles; x forward, y left, z up, metres.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AviaryConfig {
    /// What it is, in one line, for lists.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<String>,
    /// Where the drone shall go: `[x, y, z]`. A task needs one, its own or one that it imports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_m: Option<[f64; 3]>,
    /// Where the reference system starts its drones, for plans; a task's own starts are under `start`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub starts_m: Vec<[f64; 3]>,
    /// A way from the start to the goal around what stands between: points `[x, y, z]` to fly through, for the scripted
    /// pilot and for plans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub route_m: Vec<[f64; 3]>,
    /// Whether z = 0 is solid.
    #[serde(default = "floor")]
    pub floor: bool,
    /// Four walls around the place; open above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<RoomConfig>,
    /// Obstacles.
    #[serde(default)]
    pub solids: Vec<SolidConfig>,
    /// Pillars of the reference system, 0.18 m square and 1 m high, each by its centre: `[x, y]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pillars: Vec<[f64; 2]>,
    /// Pieces of furniture, usually imported and placed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub furniture: Vec<FurnitureConfig>,
    /// Bodies that a drone can push.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub movables: Vec<MovableConfig>,
    /// Bodies that move as the goal of the first drone does, whatever is in their way, and are where it says here while the goal
    /// is at `goal_m`. Beams do not see them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub carried: Vec<SolidConfig>,
    /// Frames to fly through; with the goals `gates`, one after the other.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gates: Vec<GateConfig>,
    /// Other worlds set into this one at their `at_m`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worlds: Vec<AviaryConfig>,
    /// Worlds of which every episode draws one, instead of all the other keys.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn: Option<DrawnConfig>,
    /// Where its origin lies in the world around it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_m: Option<[f64; 3]>,
}

/// A world as its file describes it, checked, with or without a task in it.
#[derive(Clone, Debug, PartialEq)]
pub struct AviaryParts {
    /// What it is, in one line; may be empty.
    pub about: String,
    /// Where drones shall go \[m, world\]: its own goal, or those of the worlds set into it.
    pub goals: Vec<Vector3<f64>>,
    /// Where the reference system starts its drones \[m, world\].
    pub starts: Vec<Vector3<f64>>,
    /// Points to fly through on the way to each goal \[m, world\]: its own route, or those of the worlds set into it; a
    /// route may be empty.
    pub routes: Vec<Vec<Vector3<f64>>>,
    /// Frames to fly through, its own before those of the worlds set into it.
    pub gates: Vec<Gate>,
    /// What stands there.
    pub world: World,
}

fn floor() -> bool {
    true
}

impl AviaryConfig {
    /// The place of a task, with the room's walls first among its solids.
    ///
    /// # Errors
    /// When a solid is wrong, or a drone of `airframe` cannot be at the goal, or there is none.
    pub fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<Aviary, ConfigError> {
        let AviaryParts { goals, routes, gates, world, .. } = self.place(field)?;
        let Some(goal) = goals.first().copied().or(gates.first().map(|gate| gate.center)) else {
            return Err(field.reject("no key `goal_m`", "one: it has no default"));
        };
        let lowest = airframe.collision_height / 2.0;
        if self.floor && goal.z < lowest {
            let expected =
                format!("at least {lowest} m, half the drone's height, because there is a floor at z = 0");
            return Err(field.at("goal_m").at(2).refuse(goal.z, expected));
        }
        let cast = |route: &Vec<Vector3<f64>>| route.iter().map(|point| point.cast()).collect();
        Ok(Aviary { goal: goal.cast(), routes: routes.iter().map(cast).collect(), gates, world })
    }

    /// The first key that describes one world, if there is one.
    pub(super) fn key_of_one_world(&self) -> Option<&'static str> {
        let keys = [
            ("goal_m", self.goal_m.is_some()),
            ("starts_m", !self.starts_m.is_empty()),
            ("route_m", !self.route_m.is_empty()),
            ("floor", !self.floor),
            ("room", self.room.is_some()),
            ("solids", !self.solids.is_empty()),
            ("pillars", !self.pillars.is_empty()),
            ("furniture", !self.furniture.is_empty()),
            ("movables", !self.movables.is_empty()),
            ("carried", !self.carried.is_empty()),
            ("gates", !self.gates.is_empty()),
            ("worlds", !self.worlds.is_empty()),
            ("at_m", self.at_m.is_some()),
        ];
        keys.into_iter().find(|(_, written)| *written).map(|(key, _)| key)
    }

    /// The place, whether or not there is a goal.
    ///
    /// # Errors
    /// When a solid is wrong or around the goal, or there are too many.
    pub fn place(&self, field: &Field<'_>) -> Result<AviaryParts, ConfigError> {
        if self.drawn.is_some() {
            return Err(field
                .at("drawn")
                .reject("drawn worlds in a world", "them in the `aviary` of a task only"));
        }
        let goal = self.goal_m.map(|goal| field.at("goal_m").place(goal)).transpose()?;
        let world = self.own_world(goal.as_ref(), field)?;
        let gates = self.own_gates(field)?;
        let route = points(&field.at("route_m"), &self.route_m)?;
        let mut place = AviaryParts {
            about: self.about.clone().unwrap_or_default(),
            goals: goal.into_iter().collect(),
            starts: points(&field.at("starts_m"), &self.starts_m)?,
            routes: if route.is_empty() { Vec::new() } else { vec![route] },
            gates: gates.iter().map(|(gate, _)| *gate).collect(),
            world,
        };
        for (index, (gate, bar_m)) in gates.iter().enumerate() {
            place.world.solids.extend(gate.frame(&format!("gate {}", index + 1), *bar_m));
        }
        for (index, inner) in self.worlds.iter().enumerate() {
            let field = field.at("worlds").at(index);
            place.take_in(inner.place(&field)?, self);
        }
        self.refuse_blocked_route(&place, field)?;
        if let Some(at) = self.at_m {
            place.shift(field.at("at_m").place(at)?);
        }
        let count = place.world.solids.len() + place.world.movables.len();
        if count > SOLIDS_LIMIT {
            return Err(field.reject(format!("{count} solids"), format!("at most {SOLIDS_LIMIT}")));
        }
        Ok(place)
    }

    /// Its own gates, and the widths of their bars \[m\].
    fn own_gates(&self, field: &Field<'_>) -> Result<Vec<(Gate, f64)>, ConfigError> {
        let gate = |(index, gate): (usize, &GateConfig)| gate.check(&field.at("gates").at(index));
        self.gates.iter().enumerate().map(gate).collect()
    }

    /// Refuses points of its own route that are inside a solid.
    fn refuse_blocked_route(&self, place: &AviaryParts, field: &Field<'_>) -> Result<(), ConfigError> {
        let Some(route) = place.routes.first().filter(|_| !self.route_m.is_empty()) else { return Ok(()) };
        let blocked = |point: &Vector3<f64>| place.world.solids.iter().any(|solid| holds(solid, point));
        match route.iter().position(blocked) {
            None => Ok(()),
            Some(index) => {
                let found = format!("{:?}, inside a solid", self.route_m[index]);
                Err(field.at("route_m").at(index).reject(found, "a point to fly through"))
            }
        }
    }

    /// What stands in it, each thing with its bodies.
    fn pieces(&self, goal: Option<&Vector3<f64>>, field: &Field<'_>) -> Result<Vec<Vec<Solid>>, ConfigError> {
        let mut pieces = Vec::new();
        for (index, solid) in self.solids.iter().enumerate() {
            let field = field.at("solids").at(index);
            let solids = solid.check(&field)?;
            if goal.is_some_and(|goal| solids.iter().any(|solid| holds(solid, goal))) {
                return Err(field.reject("a solid around the goal", "one that leaves `goal_m` free"));
            }
            pieces.push(solids);
        }
        for (index, center) in self.pillars.iter().enumerate() {
            pieces.push(vec![pillar(*center, &field.at("pillars").at(index))?]);
        }
        for (index, piece) in self.furniture.iter().enumerate() {
            pieces.push(piece.check(&field.at("furniture").at(index))?);
        }
        Ok(pieces)
    }

    /// The place without what can be moved in it, which is all that stands there but what to land on; and that.
    ///
    /// # Errors
    /// As [`Self::check`], and where something else than furniture is there.
    pub(super) fn with_pieces_apart(
        &self,
        airframe: &Airframe,
        field: &Field<'_>,
    ) -> Result<(Aviary, Vec<Vec<Solid>>), ConfigError> {
        let others = [
            ("movables", !self.movables.is_empty()),
            ("carried", !self.carried.is_empty()),
            ("gates", !self.gates.is_empty()),
            ("worlds", !self.worlds.is_empty()),
            ("at_m", self.at_m.is_some()),
        ];
        if let Some((key, _)) = others.into_iter().find(|(_, written)| *written) {
            return Err(field
                .at(key)
                .reject("a key beside furniture", "`room`, `solids`, `pillars`, `furniture`"));
        }
        let whole = self.check(airframe, field)?;
        let goal = whole.goal.cast();
        let is_moved = |piece: &Vec<Solid>| piece.iter().all(|solid| solid.role != Role::Landing);
        let (moved, stays): (Vec<_>, Vec<_>) = self.pieces(Some(&goal), field)?.into_iter().partition(is_moved);
        let walls = whole.world.solids.len() - moved.iter().chain(&stays).map(Vec::len).sum::<usize>();
        let solids = whole.world.solids.iter().take(walls).cloned().chain(stays.into_iter().flatten()).collect();
        Ok((Aviary { world: World { solids, ..whole.world }, ..whole }, moved))
    }

    /// What is written here, without the worlds set into it.
    fn own_world(&self, goal: Option<&Vector3<f64>>, field: &Field<'_>) -> Result<World, ConfigError> {
        let mut world = World { floor: if self.floor { Floor::Solid } else { Floor::Absent }, ..World::empty() };
        if let Some(room) = &self.room {
            world.solids.extend(room.check(goal, &field.at("room"))?);
        }
        world.solids.extend(self.pieces(goal, field)?.into_iter().flatten());
        for (index, movable) in self.movables.iter().enumerate() {
            world.movables.push(movable.check(&field.at("movables").at(index))?);
        }
        for (index, solid) in self.carried.iter().enumerate() {
            let solids = solid.check(&field.at("carried").at(index))?;
            let carried = solids.into_iter().map(|solid| Movable { solid, drive: Drive::Carried });
            world.movables.extend(carried);
        }
        Ok(world)
    }
}

impl AviaryParts {
    /// The world in the file at `path`.
    ///
    /// # Errors
    /// What is wrong with the file or one that it imports.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let document = Document::read(path)?;
        document.decode::<AviaryConfig>()?.place(&document.root())
    }

    /// Adds the contents of `inner`; its goals and its routes only where the outer world has none of its own.
    fn take_in(&mut self, inner: Self, outer: &AviaryConfig) {
        if outer.goal_m.is_none() {
            self.goals.extend(inner.goals);
        }
        if outer.route_m.is_empty() {
            let none = if inner.routes.is_empty() { vec![Vec::new()] } else { Vec::new() };
            self.routes.extend(inner.routes.into_iter().chain(none));
        }
        self.starts.extend(inner.starts);
        self.gates.extend(inner.gates);
        self.world.solids.extend(inner.world.solids);
        self.world.movables.extend(inner.world.movables);
    }

    fn shift(&mut self, by: Vector3<f64>) {
        let World { solids, movables, .. } = &mut self.world;
        let solids = solids.iter_mut().chain(movables.iter_mut().map(|movable| &mut movable.solid));
        let positions = solids.map(|solid| &mut solid.pose.position);
        let gates = self.gates.iter_mut().map(|gate| &mut gate.center);
        let points =
            self.goals.iter_mut().chain(&mut self.starts).chain(self.routes.iter_mut().flatten()).chain(gates);
        for position in points.chain(positions) {
            *position += by;
        }
    }
}

fn points(field: &Field<'_>, points: &[[f64; 3]]) -> Result<Vec<Vector3<f64>>, ConfigError> {
    points.iter().enumerate().map(|(index, point)| field.at(index).place(*point)).collect()
}
