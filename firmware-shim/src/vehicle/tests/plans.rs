//! Missions and fences, uploaded and flown.

use mavlink::MessageData;
use mavlink::dialects::common::{MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavMissionResult};

use super::*;

/// A waypoint `height_m` above the origin of the world, east and north of it \[m\].
fn waypoint(seq: u16, command: MavCmd, [east, north, height_m]: [f32; 3]) -> MISSION_ITEM_INT_DATA {
    let [x, y] = Home::default().place_of(&nalgebra::Vector3::new(east, north, 0.0)).integers();
    MISSION_ITEM_INT_DATA {
        seq,
        command,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        x,
        y,
        z: height_m,
        param4: NAN,
        autocontinue: 1,
        target_system: 1,
        target_component: 1,
        ..MISSION_ITEM_INT_DATA::default()
    }
}

impl Rig {
    fn upload(&mut self, items: &[MISSION_ITEM_INT_DATA]) {
        let count = MISSION_COUNT_DATA { count: items.len() as u16, target_system: 1, target_component: 1 };
        let mut answers = self.answers(&datagram(&count));
        for item in items {
            assert!(
                matches!(&answers[..], [MavMessage::MISSION_REQUEST_INT(request)] if request.seq == item.seq),
                "{answers:?}"
            );
            answers = self.answers(&datagram(item));
        }
        let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
        assert!(matches!(&answers[..], [MavMessage::MISSION_ACK(ack)] if ack.mavtype == accepted), "{answers:?}");
    }
}

fn square() -> [MISSION_ITEM_INT_DATA; 5] {
    use MavCmd::{MAV_CMD_NAV_LAND, MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_WAYPOINT};
    [
        waypoint(0, MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 1.2]),
        waypoint(1, MAV_CMD_NAV_WAYPOINT, [1.0, 0.0, 1.2]),
        waypoint(2, MAV_CMD_NAV_WAYPOINT, [1.0, 1.0, 1.0]),
        waypoint(3, MAV_CMD_NAV_WAYPOINT, [0.0, 1.0, 1.0]),
        waypoint(4, MAV_CMD_NAV_LAND, [0.0, 1.0, 0.0]),
    ]
}

#[test]
fn a_mission_is_flown_from_the_ground_to_the_ground() {
    let mut rig = Rig::new();
    rig.upload(&square());
    let start = [129.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0];
    rig.refused(MavCmd::MAV_CMD_DO_SET_MODE, start, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.fly(1.1);
    rig.accepted(MavCmd::MAV_CMD_DO_SET_MODE, start);
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Mission.custom_mode());
    rig.heard.clear();
    let mut farthest = 0.0_f32;
    for _ in 0..6000 {
        rig.tick();
        farthest = farthest.max(rig.plant.state().position.x);
    }
    let reached: Vec<u16> = rig
        .heard
        .iter()
        .filter_map(|message| match message {
            MavMessage::MISSION_ITEM_REACHED(item) => Some(item.seq),
            _ => None,
        })
        .collect();
    let expected: Vec<u16> = (0..5).flat_map(|sequence| [sequence; 4]).collect();
    assert_eq!(reached, expected, "each is told four times, as it may be lost");
    assert!((farthest - 1.0).abs() < 0.25, "{farthest} m");
    let position = rig.plant.state().position;
    assert!((position - nalgebra::Vector3::new(0.0, 1.0, 0.0)).norm() < 0.25, "{position}");
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
}

#[test]
fn a_mission_is_paused_and_gone_on_with() {
    let mut rig = Rig::new();
    rig.upload(&square());
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.accepted(MavCmd::MAV_CMD_MISSION_START, DISARM);
    rig.fly(6.0);
    let answers = rig.answers(&datagram(&set_point([0.0, 3.0, -1.0])));
    assert_eq!(texts(&answers), ["set-point refused: a mission is flown"]);
    rig.accepted(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, DISARM);
    rig.fly(2.0);
    let held = rig.plant.state().position;
    rig.fly(5.0);
    assert!((rig.plant.state().position - held).norm() < 0.1);
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Policy.custom_mode());
    rig.accepted(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, ARM);
    rig.fly(60.0);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    assert!((rig.plant.state().position.y - 1.0).abs() < 0.25);
}

#[test]
fn an_uploaded_fence_is_respected() {
    let mut rig = Rig::flying();
    // A circle to stay in, of 1 m around the origin.
    let circle =
        MISSION_ITEM_INT_DATA { param1: 1.0, ..waypoint(0, MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, [0.0; 3]) };
    let mut fields = [0; 38];
    circle.ser(mavlink::MavlinkVersion::V2, &mut fields);
    fields[37] = 1;
    let count = Payload::new(44, 221, &[1, 0, 1, 1, 1]);
    for payload in [count, Payload::new(73, 38, &fields)] {
        rig.answers(&Encoder::new(255, 190).encode(&payload));
    }
    rig.fly(1.0);
    let answers = rig.answers(&datagram(&set_point([0.0, 2.0, -1.0])));
    assert_eq!(texts(&answers), ["refused: outside the fence"]);
    rig.accepted(MavCmd::MAV_CMD_DO_FENCE_ENABLE, DISARM);
    rig.fly(1.1);
    assert_eq!(texts(&rig.answers(&datagram(&set_point([0.0, 2.0, -1.0])))), Vec::<&str>::new());
}

#[test]
fn turns_around_a_point_are_flown_and_counted() {
    use MavCmd::{MAV_CMD_NAV_LAND, MAV_CMD_NAV_LOITER_TURNS, MAV_CMD_NAV_TAKEOFF};
    let mut rig = Rig::new();
    // Two turns counter-clockwise, at 0.8 m from the point.
    let circle = MISSION_ITEM_INT_DATA {
        param1: 2.0,
        param3: -0.8,
        ..waypoint(1, MAV_CMD_NAV_LOITER_TURNS, [1.0, 0.0, 1.2])
    };
    let landing = waypoint(2, MAV_CMD_NAV_LAND, [1.8, 0.0, 0.0]);
    rig.upload(&[waypoint(0, MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 1.2]), circle, landing]);
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.accepted(MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    let (mut swept, mut last, mut worst) = (0.0_f32, 0.0_f32, 0.0_f32);
    for _ in 0..9000 {
        rig.tick();
        let from = rig.plant.state().position - nalgebra::Vector3::new(1.0, 0.0, 1.2);
        let bearing = from.y.atan2(from.x);
        if rig.vehicle.runner.current() == 1 && rig.vehicle.mode() == Mode::Guided && from.xy().norm() > 0.6 {
            let (sine, cosine) = (bearing - last).sin_cos();
            swept += sine.atan2(cosine);
            worst = worst.max((from.xy().norm() - 0.8).abs());
        }
        last = bearing;
    }
    assert!((swept - 4.0 * core::f32::consts::PI).abs() < 0.6, "{swept} rad");
    assert!(worst < 0.2, "{worst} m aside");
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
}
