//! A room whose furniture stands elsewhere.

use nalgebra::Vector3;

use super::furnishing::{Extent, TRIES, around_starts, overlap, within};
use super::{Room, STARTS};
use crate::contact::Passage;
use crate::scenario::Aviary;
use crate::seed::Stream;
use crate::world::{Cuboid, Solid, World};

/// Least distance between the way to the goal and everything else \[m\]: the open cupboards of room 2 leave no more.
const LEAST_CLEARANCE_M: f64 = 0.12;

/// Around the starts, kept free up to the ceiling \[m\]: the couch of room 0 is 25 cm away.
const START_REACH_M: f64 = 0.2;

/// Tenths of the shift that are left after draws of a room without a free way: none is the room as it is.
pub(super) const TENTHS: u32 = 10;

/// What rooms with moved furniture are drawn from.
#[derive(Clone, Debug, PartialEq)]
pub struct Rearranger {
    /// The room with what stays where it is.
    pub aviary: Aviary,
    /// What is moved: the bodies of each piece.
    pub pieces: Vec<Vec<Solid>>,
    /// Farthest along x, and along y \[m\].
    pub shift_m: f32,
    /// In which the ways lead \[m, world\].
    pub bounds: Cuboid,
    /// Of the drone's hull, for which the ways are \[m\].
    pub radius: f64,
}

impl Rearranger {
    /// The air around the starts that is free in every room \[m\].
    pub fn kept_free() -> Cuboid {
        let (low, high) = around_starts(START_REACH_M);
        Cuboid { low: low.cast(), high: high.cast() }
    }

    /// The room as it is, if it keeps the air around the starts free and has a free way.
    pub fn unmoved(&self) -> Option<Room> {
        let is_clear =
            |piece: &Vec<Solid>| extents(piece).iter().all(|part| !overlap(part, &around_starts(START_REACH_M)));
        self.pieces.iter().all(is_clear).then(|| self.room(&self.pieces))?
    }

    /// A room whose pieces are moved by up to so many tenths of the shift.
    pub(super) fn draw(&self, tenths: u32, stream: &mut Stream) -> Option<Room> {
        if tenths == 0 {
            return self.unmoved();
        }
        let reach = self.shift_m * tenths as f32 / TENTHS as f32;
        let mut placed: Vec<Vec<Solid>> = Vec::with_capacity(self.pieces.len());
        for (index, piece) in self.pieces.iter().enumerate() {
            let place = (0..TRIES).find_map(|_| {
                let [x, y] = [0, 1].map(|_| within(stream, [-reach, reach], 100.0));
                let piece = moved(piece, &Vector3::new(x, y, 0.0));
                self.is_apart(index, &piece, &placed).then_some(piece)
            });
            placed.push(place?);
        }
        self.room(&placed)
    }

    /// Whether a piece that was moved stands in nothing in which it did not stand before, and not around the starts.
    fn is_apart(&self, index: usize, piece: &[Solid], placed: &[Vec<Solid>]) -> bool {
        let (before, now) = (extents(&self.pieces[index]), extents(piece));
        let stays = self.aviary.world.solids.iter().map(|solid| (vec![solid.extent()], vec![solid.extent()]));
        let others = self.pieces.iter().zip(placed).map(|(was, is)| (extents(was), extents(is)));
        !meet(&now, &[around_starts(START_REACH_M)])
            && stays.chain(others).all(|(was, is)| meet(&before, &was) || !meet(&now, &is))
    }

    /// The room with its pieces there, if it has a free way.
    fn room(&self, pieces: &[Vec<Solid>]) -> Option<Room> {
        let stays = &self.aviary.world;
        let solids = stays.solids.iter().chain(pieces.iter().flatten()).cloned().collect();
        let world = World { floor: stays.floor, solids, ..World::empty() };
        let goal = self.aviary.goal;
        let is_free =
            Passage { world: &world, bounds: self.bounds, starts: STARTS, goal, clearance_m: LEAST_CLEARANCE_M }
                .is_free();
        is_free.then(|| Room::with_ways(world, goal, self.bounds, self.radius))
    }
}

fn moved(piece: &[Solid], by: &Vector3<f64>) -> Vec<Solid> {
    let mut piece = piece.to_vec();
    for solid in &mut piece {
        solid.pose.position += by;
    }
    piece
}

fn extents(piece: &[Solid]) -> Vec<Extent> {
    piece.iter().map(Solid::extent).collect()
}

/// Whether any two of them have a point in common.
fn meet(ones: &[Extent], others: &[Extent]) -> bool {
    ones.iter().any(|one| others.iter().any(|other| overlap(one, other)))
}
