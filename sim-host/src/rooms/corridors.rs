//! Corridors as they are drawn: passages at right angles, some of them blind, from a lobby where flights start to one with the
//! goal.

use nalgebra::{Vector3, vector};

use super::CLEARANCE_M;
use super::furnishing::{WALL_COLOUR, WALL_M, walls};
use crate::contact::Passage;
use crate::seed::Stream;
use crate::world::{Cuboid, Floor, Solid, World};

/// Corners of the hall \[m\].
pub(super) const HALL: Cuboid = Cuboid { low: vector![-1.0, -2.0, 0.0], high: vector![11.0, 2.0, 1.5] };

/// Squares of a metre between the lobbies, along and across the hall.
const COLUMNS: usize = 10;
const ROWS: usize = 4;

/// Places: the lobby at the start, the squares, column by column, and the lobby with the goal.
const PLACES: usize = COLUMNS * ROWS + 2;

/// Height of goals, and the middle of the starts \[m\].
const HEIGHT_M: f32 = 0.75;
const START: Vector3<f32> = vector![-0.5, 0.0, HEIGHT_M];

/// Where goals are \[m\].
const GOAL_X_M: f32 = 10.5;
const GOAL_Y_M: f32 = 1.5;

/// What corridors are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corridors {
    /// Share of the walls that are left out beside those that would leave no way, in \[0, 1\]: more than one way, fewer blind ends.
    pub loops: f32,
}

/// What may stand between two places: a wall of a metre.
struct Border {
    /// On both sides of it.
    places: [usize; 2],
    /// Its middle \[m\].
    middle: [f64; 2],
    /// Whether it stands across the hall.
    across: bool,
}

impl Corridors {
    /// Where goals can be \[m\].
    pub(super) fn goals() -> Cuboid {
        Cuboid {
            low: Vector3::new(GOAL_X_M, -GOAL_Y_M, HEIGHT_M),
            high: Vector3::new(GOAL_X_M, GOAL_Y_M, HEIGHT_M),
        }
    }

    /// The lobby at the start \[m\].
    pub(super) fn kept_free() -> Cuboid {
        let high = Vector3::new(-(WALL_M as f32) / 2.0, HALL.high.y, HALL.high.z);
        Cuboid { low: HALL.low, high }
    }

    /// The hall without a wall inside.
    pub(super) fn bare() -> World {
        World { floor: Floor::Solid, solids: walls(&HALL), ..World::empty() }
    }

    /// Corridors and a goal behind them, unless the way is straight.
    pub(super) fn draw(&self, stream: &mut Stream) -> Option<(World, Vector3<f32>)> {
        let goal = Vector3::new(GOAL_X_M, stream.between(-GOAL_Y_M, GOAL_Y_M), HEIGHT_M);
        let mut world = Self::bare();
        world.solids.extend(self.inner_walls(stream).iter().map(Border::wall));
        let starts = Cuboid { low: START, high: START };
        let passage = Passage { world: &world, bounds: HALL, starts, goal, clearance_m: CLEARANCE_M };
        (!passage.is_straight() && passage.is_free()).then_some((world, goal))
    }

    /// Every place can be reached: the borders without a wall have a spanning tree among them, that of their order (Kruskal 1956).
    fn inner_walls(&self, stream: &mut Stream) -> Vec<Border> {
        let mut borders = borders();
        for last in (1..borders.len()).rev() {
            borders.swap(last, stream.below(last as u32 + 1) as usize);
        }
        let mut groups: Vec<usize> = (0..PLACES).collect();
        borders.retain(|border| {
            let [one, other] = border.places.map(|place| groups[place]);
            if one == other {
                return stream.uniform() >= self.loops;
            }
            groups.iter_mut().filter(|group| **group == other).for_each(|group| *group = one);
            false
        });
        borders
    }
}

/// All that may stand between two places.
fn borders() -> Vec<Border> {
    let square = |column: usize, row: usize| 1 + column * ROWS + row;
    let left_of = |row: usize| f64::from(HALL.low.y) + row as f64;
    let across =
        (0..=COLUMNS).flat_map(|column| (0..ROWS).map(move |row| (column, row))).map(|(column, row)| Border {
            places: [
                column.checked_sub(1).map_or(0, |before| square(before, row)),
                if column == COLUMNS { PLACES - 1 } else { square(column, row) },
            ],
            middle: [column as f64, left_of(row) + 0.5],
            across: true,
        });
    let along =
        (0..COLUMNS).flat_map(|column| (1..ROWS).map(move |row| (column, row))).map(|(column, row)| Border {
            places: [square(column, row - 1), square(column, row)],
            middle: [column as f64 + 0.5, left_of(row)],
            across: false,
        });
    across.chain(along).collect()
}

impl Border {
    /// From the floor to the ceiling.
    fn wall(&self) -> Solid {
        let (thin, long) = (WALL_M / 2.0, WALL_M.midpoint(1.0));
        let [x, y] = if self.across { [thin, long] } else { [long, thin] };
        let half = Vector3::new(x, y, f64::from(HALL.high.z) / 2.0);
        let middle = Vector3::new(self.middle[0], self.middle[1], half.z);
        Solid { colour: WALL_COLOUR, ..Solid::block("corridor wall", middle - half, middle + half) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, Seed};

    fn walls_of(loops: f32, number: u32) -> Vec<Border> {
        Corridors { loops }.inner_walls(&mut Stream::new(Seed(1), number, Purpose::Furnishing))
    }

    #[test]
    fn a_border_lies_between_two_places() {
        let all = borders();
        assert_eq!(all.len(), (COLUMNS + 1) * ROWS + COLUMNS * (ROWS - 1));
        for place in 0..PLACES {
            let count = all.iter().filter(|border| border.places.contains(&place)).count();
            let (column, row) = ((place.max(1) - 1) / ROWS, (place.max(1) - 1) % ROWS);
            let expected = if place == 0 || place == PLACES - 1 {
                ROWS
            } else {
                3 + usize::from((1..ROWS - 1).contains(&row))
            };
            assert_eq!(count, expected, "place {place}, column {column}");
        }
    }

    #[test]
    fn walls_leave_one_way_between_two_places_and_loops_leave_more() {
        let (all, tree) = (borders().len(), PLACES - 1);
        for number in 0..20 {
            assert_eq!(walls_of(0.0, number).len(), all - tree);
            assert_eq!(walls_of(1.0, number).len(), 0);
            let some = walls_of(0.3, number).len();
            assert!((1..all - tree).contains(&some), "{some}");
        }
    }

    #[test]
    fn a_wall_stands_on_its_border_from_the_floor_to_the_ceiling() {
        for border in borders() {
            let bounds = border.wall().bounds();
            assert_eq!([bounds.low.z, bounds.high.z], [0.0, HALL.high.z]);
            let size = bounds.high - bounds.low;
            assert!((size.x.max(size.y) - 1.1).abs() < 1e-5 && (size.x.min(size.y) - 0.1).abs() < 1e-5, "{size}");
            assert!(bounds.low.x >= -0.051 && bounds.high.x <= 10.051, "both lobbies stay free");
        }
    }
}
