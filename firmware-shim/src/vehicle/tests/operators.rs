//! Two ground stations, one drone.

use super::*;
use crate::parameter::ParameterValue;

/// Another ground station.
const OTHER: u8 = 245;

/// What another ground station is told of a command.
fn result_of(rig: &mut Rig, command: MavCmd, parameters: [f32; 7]) -> MavResult {
    rig.heard.clear();
    rig.receive(&datagram_of(OTHER, &command_long(command, parameters)));
    let acknowledged = rig.heard.iter().find_map(|message| match message {
        MavMessage::COMMAND_ACK(answer) => Some(answer.result),
        _ => None,
    });
    acknowledged.unwrap()
}

/// `MAV_CMD_REQUEST_OPERATOR_CONTROL` of a system; the dialect of the `mavlink` crate does not know its number.
fn ask_for_control(rig: &mut Rig, system: u8, action: f32, takeover: f32) -> u8 {
    let mut fields = [0; 33];
    for (place, number) in fields.chunks_exact_mut(4).zip([0.0, action, takeover, 3.0_f32]) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    fields[28..30].copy_from_slice(&32_100_u16.to_le_bytes());
    fields[30] = 1;
    let datagram = Encoder::new(system, 190).encode(&Payload::new(76, 152, &fields));
    let mut result = None;
    rig.vehicle.receive(PEER, &datagram, &mut |frame| {
        let frame = Frames::new(frame).next().unwrap().unwrap();
        if frame.message_id == 77 {
            result = Some(frame.fields::<10>()[2]);
        }
    });
    // No command is the repetition of another one.
    rig.fly(3.0);
    result.unwrap()
}

/// `CONTROL_STATUS` as a third one is told that asks for it.
fn status(rig: &mut Rig) -> [u8; 2] {
    // No request is the repetition of another one.
    rig.fly(2.1);
    let request = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [512.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut answers = Vec::new();
    rig.vehicle.receive(PEER, &datagram_of(7, &request), &mut |frame| answers.extend(control_status(frame)));
    answers[0]
}

fn control_status(frame: &[u8]) -> Option<[u8; 2]> {
    let frame = Frames::new(frame).next().unwrap().unwrap();
    (frame.message_id == CONTROL_STATUS).then(|| frame.fields())
}

#[test]
fn who_has_the_control_is_told_once_a_second_when_several_speak() {
    let mut rig = Rig::flying();
    let told = |rig: &mut Rig| {
        let mut told = Vec::new();
        for _ in 0..300 {
            rig.vehicle.tick(rig.plant.state(), &[PEER], &mut |_, frame| told.extend(control_status(frame)));
        }
        told
    };
    assert_eq!(told(&mut rig), [[0; 2]; 0]);
    // Its pilot is there.
    rig.receive(&datagram(&HEARTBEAT_DATA::default()));
    rig.receive(&datagram_of(OTHER, &HEARTBEAT_DATA::default()));
    assert_eq!(told(&mut rig), [[255, 3]; 3]);
}

const ACCEPTED: u8 = 0;
const FAILED: u8 = 4;
const TO_PID: [f32; 7] = [129.0, 4.0, 12.0, 0.0, 0.0, 0.0, 0.0];
const SPEED: [f32; 7] = [1.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0];

#[test]
fn whoever_flies_the_drone_has_the_control_until_it_has_landed() {
    use MavResult::{MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED};
    let mut rig = Rig::flying();
    assert_eq!(status(&mut rig), [255, 3]);
    // Its pilot is there.
    rig.receive(&datagram(&HEARTBEAT_DATA::default()));
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_DO_CHANGE_SPEED, SPEED), MAV_RESULT_FAILED);
    assert_eq!(texts(&rig.heard), ["refused: another client has the control"]);
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, TO_PID), MAV_RESULT_FAILED);
    assert_eq!(rig.vehicle.active_controller(), Controller::Policy);
    rig.heard.clear();
    rig.fly(2.0);
    rig.receive(&datagram_of(OTHER, &set_point([3.0, 0.0, -1.0])));
    assert_eq!(texts(&rig.heard), ["refused: another client has the control"]);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    // What is only asked is answered.
    let home = [242.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_REQUEST_MESSAGE, home), MAV_RESULT_ACCEPTED);
    rig.accepted(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN);
    rig.fly(8.0);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    assert_eq!(status(&mut rig), [0, 3]);
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM), MAV_RESULT_ACCEPTED);
    assert_eq!(status(&mut rig), [OTHER, 3]);
}

#[test]
fn anybody_may_stop_a_drone_and_no_stream_undoes_it() {
    let mut rig = Rig::flying();
    let paused = [0.0; 7];
    let there = datagram(&set_point([3.0, 0.0, -1.0]));
    rig.receive(&there);
    assert_eq!(rig.vehicle.mode(), Mode::Guided);
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, paused), MavResult::MAV_RESULT_ACCEPTED);
    rig.heard.clear();
    rig.receive(&there);
    assert_eq!(texts(&rig.heard), ["set-point refused: another client intervened"]);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    let [x, y, z] = [1.0, 0.0, 1.2];
    let sent = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        frame: MavFrame::MAV_FRAME_LOCAL_NED,
        x: (x * 1e4) as i32,
        y: (y * 1e4) as i32,
        z: -z,
        target_system: 1,
        target_component: 1,
        ..COMMAND_INT_DATA::default()
    };
    rig.receive(&datagram(&sent));
    rig.receive(&there);
    assert_eq!(rig.vehicle.mode(), Mode::Guided, "its pilot has commanded something");
}

#[test]
fn control_is_asked_for_given_back_and_taken_from_the_silent() {
    let mut rig = Rig::flying();
    assert_eq!(ask_for_control(&mut rig, OTHER, 1.0, 0.0), ACCEPTED, "nobody had asked for it");
    assert_eq!(status(&mut rig), [OTHER, 1]);
    rig.refused(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN, MavResult::MAV_RESULT_FAILED);
    assert_eq!(ask_for_control(&mut rig, 255, 1.0, 1.0), FAILED);
    assert_eq!(ask_for_control(&mut rig, 255, 0.0, 0.0), FAILED, "it is not its own");
    assert_eq!(ask_for_control(&mut rig, OTHER, 0.0, 0.0), ACCEPTED);
    assert_eq!(status(&mut rig), [0, 3]);
    assert_eq!(ask_for_control(&mut rig, 255, 1.0, 1.0), ACCEPTED);
    assert_eq!(status(&mut rig), [255, 3]);
    assert_eq!(ask_for_control(&mut rig, OTHER, 1.0, 0.0), ACCEPTED, "it lets others have it");
    rig.fly(6.0);
    assert_eq!(status(&mut rig), [0, 3], "it is silent");
}

#[test]
fn who_has_the_control_hears_of_those_who_ask_for_it() {
    let mut rig = Rig::flying();
    ask_for_control(&mut rig, OTHER, 1.0, 0.0);
    let mut fields = [0; 33];
    fields[4..8].copy_from_slice(&1_f32.to_le_bytes());
    fields[28..30].copy_from_slice(&32_100_u16.to_le_bytes());
    fields[30] = 1;
    rig.vehicle.receive(PEER, &Encoder::new(255, 190).encode(&Payload::new(76, 152, &fields)), &mut |_| {});
    let mut forwarded = Vec::new();
    rig.vehicle.tick(rig.plant.state(), &[PEER, ANOTHER], &mut |peer, frame| {
        let frame = Frames::new(frame).next().unwrap().unwrap();
        if frame.message_id == 76 {
            let told: [u8; 33] = frame.fields();
            forwarded.push((peer, told[..4].to_vec(), told[28..31].to_vec()));
        }
    });
    let [low, high] = 32_100_u16.to_le_bytes();
    let told = |peer| (peer, 255_f32.to_le_bytes().to_vec(), vec![low, high, OTHER]);
    assert_eq!(forwarded, [told(PEER), told(ANOTHER)]);
}

#[test]
fn plans_and_parameters_are_those_of_who_has_the_control() {
    let mut rig = Rig::flying();
    rig.heard.clear();
    rig.receive(&datagram_of(OTHER, &parameter("MIS_TAKEOFF_ALT", 1.7)));
    assert!(
        matches!(&rig.heard[..], [MavMessage::STATUSTEXT(_), MavMessage::PARAM_VALUE(told)] if told.param_value == 1.0),
        "{:?}",
        rig.heard
    );
    rig.heard.clear();
    let count = mavlink::dialects::common::MISSION_COUNT_DATA { count: 2, target_system: 1, target_component: 1 };
    rig.receive(&datagram_of(OTHER, &count));
    let denied = mavlink::dialects::common::MavMissionResult::MAV_MISSION_DENIED;
    assert!(matches!(&rig.heard[..], [MavMessage::MISSION_ACK(answer)] if answer.mavtype == denied));
}

#[test]
fn a_client_of_a_crazyflie_is_one_of_the_operators() {
    let mut rig = Rig::flying();
    let stop = Command::StopMotors;
    let refused = Err(Refusal::OtherOperator);
    assert_eq!(rig.vehicle.order_as(Operator::CrazyflieClient, stop), refused, "its set-point of nothing");
    assert_eq!(rig.vehicle.order_as(Operator::CrazyflieClient, Command::Land), Ok(()));
    rig.fly(8.0);
    assert_eq!(rig.vehicle.order_as(Operator::CrazyflieClient, Command::Arm), Ok(()));
    assert_eq!(status(&mut rig), [254, 3]);
    rig.refused(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN, MavResult::MAV_RESULT_FAILED);
}

#[test]
fn who_asks_for_a_task_has_the_control_while_it_is_flown() {
    let mut rig = Rig::new();
    rig.vehicle.offer_task(PolicyRole::SetPointsToo);
    rig.accepted(MavCmd::MAV_CMD_USER_1, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for _ in 0..5 {
        rig.vehicle.tend_task(&mut rig.plant);
        rig.tick();
    }
    assert!(rig.vehicle.mode().flies());
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, TO_PID), MavResult::MAV_RESULT_FAILED);
}

#[test]
fn with_another_parameter_the_last_one_is_obeyed() {
    let mut rig = Rig::flying();
    let mut parameters = rig.vehicle.parameters().clone();
    parameters.set(Parameter::RlOneOperator, ParameterValue::Integer(0)).unwrap();
    rig.vehicle.adjust(parameters);
    assert_eq!(result_of(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, TO_PID), MavResult::MAV_RESULT_ACCEPTED);
}
