//! Pieces of furniture, which the mouse moves.

use kestrel_sim::world::{Solid, World};
use nalgebra::Vector3;

/// Parts of a piece are nearer to each other than this \[m\].
const JOINT_M: f32 = 0.03;

/// Between the name of a piece and that of a part.
const PART: &str = ": ";

/// The solids that are one piece of furniture with that of index `part`; nothing where it is no furniture.
pub(crate) fn piece(world: &World, part: usize) -> Option<Vec<usize>> {
    let (name, _) = world.solids.get(part)?.name.split_once(PART)?;
    let is_alike = |solid: &Solid| solid.name.split_once(PART).is_some_and(|(found, _)| found == name);
    // Another piece of the same name stands elsewhere.
    let mut found = vec![part];
    let mut next = 0;
    while let Some(&of) = found.get(next) {
        let bounds = world.solids[of].bounds();
        for (index, solid) in world.solids.iter().enumerate().filter(|(_, solid)| is_alike(solid)) {
            let other = solid.bounds();
            let touches = (0..3).all(|axis| {
                bounds.low[axis] < other.high[axis] + JOINT_M && other.low[axis] < bounds.high[axis] + JOINT_M
            });
            if touches && !found.contains(&index) {
                found.push(index);
            }
        }
        next += 1;
    }
    found.sort_unstable();
    Some(found)
}

/// Moves solids by a way \[m, world\].
pub(crate) fn shift(world: &mut World, parts: &[usize], way: Vector3<f64>) {
    for part in parts {
        if let Some(solid) = world.solids.get_mut(*part) {
            solid.pose.position += way;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table_at(x: f64) -> [Solid; 2] {
        let block = |name, low: [f64; 3], high: [f64; 3]| {
            let aside = Vector3::new(x, 0.0, 0.0);
            Solid::block(name, Vector3::from(low) + aside, Vector3::from(high) + aside)
        };
        [
            block("table: leg", [0.0, 0.0, 0.0], [0.1, 0.1, 0.7]),
            block("table: top", [0.0, 0.0, 0.7], [1.0, 1.0, 0.75]),
        ]
    }

    #[test]
    fn two_tables_are_two_pieces_and_a_wall_is_none() {
        let mut world = World::empty();
        world.solids.push(Solid::block("wall", Vector3::new(-1.0, -1.0, 0.0), Vector3::new(-0.01, 1.0, 2.0)));
        world.solids.extend(table_at(0.0).into_iter().chain(table_at(2.0)));
        assert_eq!(piece(&world, 0), None);
        assert_eq!(piece(&world, 2), Some(vec![1, 2]));
        assert_eq!(piece(&world, 3), Some(vec![3, 4]));
        assert_eq!(piece(&world, 9), None);
        shift(&mut world, &[3, 4], Vector3::y());
        let moved: Vec<f64> = world.solids.iter().map(|solid| solid.pose.position.y).collect();
        assert_eq!(moved, [0.0, 0.05, 0.5, 1.05, 1.5]);
    }
}
