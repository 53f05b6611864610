use std::fs;

use kestrel_sim::contact::DistanceField;
use kestrel_sim::world::{Role, Solid};
use tempfile::TempDir;

use kestrel_sim::rooms::{Kind, overlap};

use super::*;
use crate::golden::in_repository;

/// Two rooms with few pieces, which are soon found.
fn order(place: &TempDir) -> Order {
    Order {
        name: "trial".to_owned(),
        count: 2,
        seed: Seed(3),
        pieces: 6,
        furniture: in_repository("assets/furniture"),
        base: in_repository("configs/aviaries/parts/room.yaml"),
        worlds: place.path().join("worlds/trial"),
        tasks: place.path().join("tasks"),
        command: "kestrel aviary generate".to_owned(),
    }
}

fn draws(count: u32, pieces: usize) -> Vec<RoomPlan> {
    let workshop = workshop(&in_repository("assets/furniture"), pieces).unwrap();
    let draw = |index| workshop.draw(pieces, &mut Stream::new(Seed(0), index, Purpose::Furnishing));
    (0..count).map(draw).collect()
}

#[test]
fn written_rooms_are_read_as_tasks_that_can_be_flown() {
    let place = tempfile::tempdir().unwrap();
    let order = order(&place);
    let rooms = generate(&order).unwrap();
    for Files { world, task } in &rooms {
        for (path, text) in [world, task] {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
    }
    assert_eq!(
        rooms.iter().map(|files| files.task.0.clone()).collect::<Vec<_>>(),
        [0, 1].map(|k| order.paths(k)[1].clone())
    );
    let tasks: Vec<_> = rooms.iter().map(|files| experiment_config::load(&files.task.0, &[]).unwrap()).collect();
    for (task, name) in tasks.iter().zip(["trial-00", "trial-01"]) {
        let scenario = &task.evaluation.scenario;
        assert_eq!(task.name, name);
        assert!(!scenario.aviary.route(0).is_empty());
        let ways = DistanceField::new(&scenario.aviary.world, &scenario.aviary.goal, ROOM, CLEARANCE_M);
        assert!(ways.free_path_from([-0.55, 0.0, 0.5]).is_some());
        let starts = Starts { seed: Seed(1), purpose: Purpose::Evaluation, episodes: 20 };
        assert!(evaluate(scenario, Flyer::Scripted, starts).success_rate >= 0.9);
        assert!(evaluate(scenario, Flyer::Nothing, starts).success_rate < 0.01);
    }
    let [one, other] = [&tasks[0].scenario, &tasks[1].scenario];
    assert_eq!((one.observation, one.action), (other.observation, other.action));
    assert_ne!(one.aviary.world, other.aviary.world);
}

#[test]
fn a_room_does_not_depend_on_how_many_there_are() {
    let place = tempfile::tempdir().unwrap();
    let two = order(&place);
    let one = Order { count: 1, ..two.clone() };
    assert_eq!(generate(&one).unwrap()[..], generate(&two).unwrap()[..1]);
}

#[test]
fn pieces_stand_apart_in_the_room_and_leave_starts_and_table_free() {
    let workshop = workshop(&in_repository("assets/furniture"), 12).unwrap();
    for room in draws(20, 12) {
        let world = workshop.world(&room);
        let (walls, inside): (Vec<_>, Vec<_>) =
            world.solids.iter().partition(|solid| solid.name.ends_with("wall"));
        assert_eq!(walls.len(), 4);
        let (low, high) = (ROOM.low.cast::<f64>(), ROOM.high.cast::<f64>());
        for solid in &inside {
            let extent = solid.extent();
            assert!(
                (0..2).all(|axis| extent.0[axis] > low[axis] && extent.1[axis] < high[axis]),
                "{}",
                solid.name
            );
        }
        let table = |solid: &&&Solid| solid.name.starts_with("goal table");
        let landing = inside.iter().find(|solid| solid.role == Role::Landing).unwrap();
        assert!((landing.pose.position.x - room.goal[0]).abs() < 1e-9 && room.goal[0] > 4.33);
        let starts = (STARTS.low.cast(), STARTS.high.cast());
        for solid in inside.iter().filter(|solid| !table(solid)) {
            let extent = solid.extent();
            assert!(!overlap(&extent, &landing.extent()) && !overlap(&extent, &starts), "{}", solid.name);
        }
    }
}

#[test]
fn draws_differ_in_every_respect() {
    let rooms = draws(20, 12);
    let all =
        |of: fn(&Kind) -> bool| rooms.iter().flat_map(|room| &room.pieces).filter(|piece| of(&piece.kind)).count();
    assert!(all(|kind| *kind == Kind::Table) == 20);
    assert!(all(|kind| *kind == Kind::Pillar) > 10);
    assert!(all(|kind| matches!(kind, Kind::Partition { .. })) > 10);
    assert!(all(|kind| matches!(kind, Kind::Furniture { .. })) > 30);
    let counts: std::collections::BTreeSet<_> = rooms.iter().map(|room| room.pieces.len()).collect();
    assert!(counts.len() > 3 && counts.iter().all(|count| (2..=13).contains(count)), "{counts:?}");
}

#[test]
fn wrong_parts_are_named() {
    let place = tempfile::tempdir().unwrap();
    let message = |order: Order| generate(&order).unwrap_err().to_string();
    let furniture = message(Order { furniture: place.path().to_owned(), ..order(&place) });
    assert!(furniture.contains(".yaml)") && furniture.contains("found no such file"), "{furniture}");
    let name = message(Order { name: "my room".to_owned(), ..order(&place) });
    assert!(name.contains("name: found the text \"my room-00\", expected 1 to 64 letters"), "{name}");
    let base = message(Order { base: place.path().join("none.yaml"), ..order(&place) });
    assert!(base.contains("import: found no such file"), "{base}");
}

#[test]
fn paths_lead_from_one_folder_to_another() {
    let relative = |folder: &str, target: &str| text::relative(Path::new(folder), Path::new(target));
    assert_eq!(relative("configs/aviaries/stream", "assets/worlds/a.yaml"), "../../../assets/worlds/a.yaml");
    assert_eq!(relative("a/b", "a/b/c.yaml"), "c.yaml");
    assert_eq!(relative("a/./x/../b", "a/parts"), "../parts");
    assert_eq!(relative("a", "a"), ".");
}
