//! A world prepared for one airframe: who touches what, and how far away everything is.

use core::fmt;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use rapier3d::parry::bounding_volume::Aabb;
use rapier3d::parry::partitioning::{Bvh, BvhBuildStrategy, BvhNode};

use super::body::Body;
use super::clearance_map::{COARSE_CELLS, ClearanceMap, FINE_CELLS};
use super::frame::to_vector;
use super::outline::{MARGIN, Outline, distance};
use super::ray_caster::{BANK, Cone, RayCaster};
use super::scanner::Scanner;
use super::{ContactReport, Motion, TOUCH_GAP, Touch};
use crate::sensor::{BEAM_LIMIT, Scan};
use crate::world::{BOX_CONTACT_GAP, Floor, Pose, Role, World};

/// Bullet keeps a contact until it opens by this share of the smaller body's radius
/// (`gContactBreakingThreshold`).
pub(super) const BREAKING_SHARE: f64 = 0.02;

/// Rounding of coordinates in `f32`, generously \[m\].
const ROUNDING: f64 = 1e-4;

/// A world prepared for one airframe. Never changes, so that environments can share it.
#[derive(Clone)]
pub struct Arena {
    pub(super) drone: Outline,
    /// Half extents of the box that Bullet keeps around the drone's hull: two margins more than the hull \[m\].
    bounds: Vector3<f64>,
    /// Gap at which Bullet lets go of a contact of the drone \[m\].
    pub(super) breaking: f64,
    pub(super) report: ContactReport,
    pub(super) floor: Floor,
    pub(super) ground: Outline,
    floor_gap: f64,
    drone_gap: f64,
    pub(super) solids: Vec<Body>,
    pub(super) movables: Vec<Body>,
    tree: Bvh,
    map: Option<ClearanceMap>,
    scanner: Option<Scanner>,
    caster: RayCaster,
    floor_height: f32,
    reach: f32,
}

/// What an arena is made from.
#[derive(PartialEq)]
struct Order {
    world: World,
    airframe: Airframe,
    report: ContactReport,
    scan: Option<Scan>,
}

/// The arenas that somebody has.
static MADE: Mutex<Vec<(Order, Weak<Arena>)>> = Mutex::new(Vec::new());

impl fmt::Debug for Arena {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Arena").finish_non_exhaustive()
    }
}

impl Arena {
    /// Prepares a world.
    ///
    /// # Panics
    /// If the points of a hull lie in one plane.
    pub fn new(world: &World, airframe: &Airframe, report: ContactReport) -> Self {
        let arena = Self::without_map(world, airframe, report);
        Self { map: ClearanceMap::new(&arena.solids, FINE_CELLS), ..arena }
    }

    /// As [`Self::new`] for a world of many, with the beams of a scan: it says the same with a sixteenth of the memory,
    /// but [`Self::clearance`], whose bound is lower.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn coarse(world: &World, airframe: &Airframe, report: ContactReport, scan: Option<&Scan>) -> Self {
        let arena = Self::without_map(world, airframe, report);
        let scanner = scan.map(|scan| Scanner::new(world, scan));
        Self { map: ClearanceMap::new(&arena.solids, COARSE_CELLS), scanner, ..arena }
    }

    /// As [`Self::new`], with the floor alone in [`Self::clearance`].
    pub(super) fn without_map(world: &World, airframe: &Airframe, report: ContactReport) -> Self {
        let solids: Vec<_> = world.tangible().map(|solid| Body::new(solid, report)).collect();
        let movables: Vec<_> = world.movables.iter().map(|movable| Body::new(&movable.solid, report)).collect();
        let drone = Outline::of_drone(airframe);
        let bounds =
            Vector3::new(airframe.collision_radius, airframe.collision_radius, 0.5 * airframe.collision_height)
                .add_scalar(2.0 * MARGIN);
        let breaking = BREAKING_SHARE * (bounds.norm() + airframe.collision_offset.abs());
        let floor_gap = match report {
            ContactReport::Touch => TOUCH_GAP,
            ContactReport::Bullet => MARGIN + breaking,
        };
        let drone_gap = floor_gap + MARGIN;
        let gaps = solids.iter().chain(&movables).map(|body| body.gap);
        let reach = drone.radius + gaps.fold(floor_gap.max(drone_gap), f64::max);
        Self {
            bounds,
            breaking,
            report,
            floor: world.floor,
            ground: Outline::of_floor(),
            floor_gap,
            drone_gap,
            tree: tree(&solids),
            map: None,
            scanner: None,
            caster: RayCaster::new(world),
            floor_height: match world.floor {
                Floor::Solid => 0.0,
                Floor::Absent => f32::NEG_INFINITY,
            },
            reach: reach as f32,
            drone,
            solids,
            movables,
        }
    }

    /// As [`Self::new`], with the beams of a scan; the same arena for everybody who asks while somebody has it, for a
    /// training run makes many simulations of one place.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn shared(world: &World, airframe: &Airframe, report: ContactReport, scan: Option<&Scan>) -> Arc<Self> {
        let wanted = Order { world: world.clone(), airframe: *airframe, report, scan: scan.cloned() };
        // A panic elsewhere leaves the list as it was: it is only ever changed as a whole.
        let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
        made.retain(|(_, arena)| arena.strong_count() > 0);
        let known = made.iter().find(|(order, _)| *order == wanted).and_then(|(_, arena)| arena.upgrade());
        known.unwrap_or_else(|| {
            let arena = Self::new(world, airframe, report);
            let arena = Arc::new(match scan {
                Some(scan) => arena.with_scan(world, scan),
                None => arena,
            });
            made.push((wanted, Arc::downgrade(&arena)));
            arena
        })
    }

    /// The same arena, prepared for the beams of a scan; `world` is the one it was made from.
    #[must_use]
    pub fn with_scan(self, world: &World, scan: &Scan) -> Self {
        Self { scanner: Some(Scanner::new(world, scan)), ..self }
    }

    /// How near the nearest thing that never moves is along each beam: one at the point, zero at the scan's limit and
    /// beyond, and without a scan. Beams that sweep are elsewhere in every `reading`.
    #[inline(always)]
    pub fn nearness(&self, point: [f32; 3], reading: usize) -> [f32; BEAM_LIMIT] {
        // A closure would not be compiled for the instruction set of the kernel around it.
        match &self.scanner {
            Some(scanner) => scanner.nearness(point, reading),
            None => [0.0; BEAM_LIMIT],
        }
    }

    /// A lower bound of the distance \[m\] between a point and everything that never moves.
    ///
    /// Looked up in a grid, so it is up to two cells too small. A point below the floor is at a negative distance;
    /// the bound of a point that is not a number means nothing.
    #[inline(always)]
    pub fn clearance(&self, x: f32, y: f32, z: f32) -> f32 {
        let above = z - self.floor_height;
        match &self.map {
            Some(map) => map.bound([x, y, z]).min(above),
            None => above,
        }
    }

    /// As [`Self::clearance`] for the points of many lanes, `[axis][lane]`.
    #[inline(always)]
    pub fn clearances<const LANES: usize>(&self, points: &[[f32; LANES]; 3]) -> [f32; LANES] {
        let above = points[2].map(|z| z - self.floor_height);
        match &self.map {
            Some(map) => {
                let bounds = map.bounds(points);
                core::array::from_fn(|lane| bounds[lane].min(above[lane]))
            }
            None => above,
        }
    }

    /// How far away the nearest thing that never moves, or person, is along each ray of a cone \[m\]; the limit where there is
    /// none. The movables are where they are now.
    #[inline(always)]
    pub(crate) fn distances_in(&self, cone: &Cone<'_>, movables: &[Motion], distances: &mut [[f32; BANK]]) {
        self.caster.distances(cone, movables, distances);
    }

    /// The plane that touches the surface of the nearest obstacle that never moves, where that is nearer than `reach`
    /// \[m\]: its normal towards the outside, and the distance of the point above it, negative inside.
    pub(crate) fn nearest_plane(&self, point: [f32; 3], reach: f32) -> Option<(Vector3<f32>, f32)> {
        let [x, y, z] = point;
        if self.clearance(x, y, z) >= reach {
            return None;
        }
        let above = z - self.floor_height;
        let floor = (above < reach).then(|| (Vector3::z(), above));
        let least = floor.map_or(reach, |(_, distance)| distance);
        let place = Vector3::new(x, y, z).cast();
        let mut nearest = (None, f64::from(least));
        for body in self.solids.iter().filter(|body| body.role == Role::Obstacle) {
            if body.distance_to_extent(&place) < nearest.1 {
                let (normal, distance) = body.plane_towards(&place);
                nearest = if distance < nearest.1 { (Some(normal), distance) } else { nearest };
            }
        }
        match nearest {
            (Some(normal), distance) => Some((normal.cast(), distance as f32)),
            (None, _) => floor,
        }
    }

    /// Whether there is nothing at all to touch.
    pub fn is_empty(&self) -> bool {
        self.floor == Floor::Absent && self.solids.is_empty() && self.movables.is_empty()
    }

    /// Radius of the sphere around the centre of mass outside of which the drone touches nothing \[m\].
    pub fn reach(&self) -> f32 {
        self.reach
    }

    /// What the drone touches in this pose, other drones aside; `movables` are where the movables are now.
    pub fn touch(&self, drone: &Pose, movables: &[Motion]) -> Touch {
        let hull = self.drone.placed(drone);
        let mut touch = Touch { obstacle: self.touches_floor(&hull), landing: false };
        let reach = f64::from(self.reach);
        for index in self.solids_within(&drone.position, reach) {
            let body = &self.solids[index];
            if self.touches_solid(&hull, body) {
                touch |= body.touched();
            }
        }
        for (body, motion) in self.movables.iter().zip(movables) {
            let apart = (motion.pose.position - drone.position).norm() > reach + body.outline.radius;
            let pose = body.outline.placed(&motion.pose);
            if !apart && distance([&self.drone.shape, &body.outline.shape], [&hull, &pose]) <= body.gap {
                touch |= body.touched();
            }
        }
        touch
    }

    /// Whether two drones touch.
    pub fn drones_touch(&self, one: &Pose, other: &Pose) -> bool {
        let apart = (one.position - other.position).norm() > 2.0 * f64::from(self.reach);
        let [one, other] = [one, other].map(|pose| self.drone.placed(pose));
        !apart && distance([&self.drone.shape, &self.drone.shape], [&one, &other]) <= self.drone_gap
    }

    /// Distance \[m\] at which a ray of unit direction meets something that never moves, if within `limit_m`: not a person.
    pub fn raycast(&self, origin: Vector3<f64>, direction: Vector3<f64>, limit_m: f64) -> Option<f64> {
        let floor = match self.floor {
            Floor::Solid if direction.z < 0.0 => Some((-origin.z / direction.z).max(0.0)),
            Floor::Solid | Floor::Absent => None,
        };
        let mut nearest = floor.filter(|distance| *distance <= limit_m);
        for body in &self.solids {
            let limit = nearest.unwrap_or(limit_m);
            let to_middle = body.shape_pose.position - origin;
            let along = to_middle.dot(&direction).clamp(0.0, limit);
            if (to_middle - direction * along).norm() <= body.outline.radius + ROUNDING {
                nearest = body.cast_ray(&origin, &direction, limit).or(nearest);
            }
        }
        nearest
    }

    /// Indices of the solids that a ball may touch.
    pub(super) fn solids_within(&self, middle: &Vector3<f64>, radius: f64) -> impl Iterator<Item = usize> {
        let half = Vector3::repeat(radius + ROUNDING);
        let ball = BvhNode::leaf(Aabb::new(to_vector(&(middle - half)), to_vector(&(middle + half))), 0);
        self.tree.leaves(move |node| node.intersects(&ball)).map(|leaf| leaf as usize)
    }

    /// Whether a solid is as near as [`ContactReport`] says. Bullet tests a surface of triangles only when the box around
    /// the drone's hull meets those of the triangles, so that its gap is one between boxes: it matters when the drone is level
    /// and heads along an axis. Then it finds the contact up to the gap of a box, as elsewhere.
    fn touches_solid(&self, hull: &Pose, body: &Body) -> bool {
        let apart = || distance([&self.drone.shape, &body.outline.shape], [hull, &body.shape_pose]);
        match self.report {
            ContactReport::Touch => apart() <= body.gap,
            ContactReport::Bullet => {
                let rows = hull.world_from_body.rows().map(Vector3::from);
                let half = Vector3::from(rows.map(|row| row.abs().dot(&self.bounds)));
                let (low, high) = &body.extent;
                let beyond = (low - hull.position).sup(&(hull.position - high)) - half;
                beyond.max() <= body.gap - 2.0 * MARGIN && apart() <= body.gap.max(BOX_CONTACT_GAP)
            }
        }
    }

    /// Whether the lowest corner of the drone's hull is near the floor.
    fn touches_floor(&self, hull: &Pose) -> bool {
        match self.floor {
            Floor::Solid => self.is_floor_pending(hull) && self.drone.lowest(hull).z <= self.floor_gap,
            Floor::Absent => false,
        }
    }

    /// Whether the box around the drone's hull meets the floor: only then Bullet looks for contact. It matters when
    /// the drone is level; the gap at which contact is reported then is two margins.
    pub(super) fn is_floor_pending(&self, hull: &Pose) -> bool {
        let up = Vector3::from(hull.world_from_body.rows()[2]).abs();
        hull.position.z - up.dot(&self.bounds) <= 0.0
    }
}

fn tree(bodies: &[Body]) -> Bvh {
    let rounding = Vector3::repeat(ROUNDING);
    let leaves: Vec<_> = bodies
        .iter()
        .map(|body| {
            let (low, high) = body.extent;
            Aabb::new(to_vector(&(low - rounding)), to_vector(&(high + rounding)))
        })
        .collect();
    Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves)
}
