//! Commands and acknowledgements over links that lose some.

use super::*;

#[test]
fn a_repeated_command_is_executed_once_and_answered_again() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(rig.result(&arm), MavResult::MAV_RESULT_ACCEPTED);
    let take_off = command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN);
    assert_eq!(rig.result(&take_off), MavResult::MAV_RESULT_ACCEPTED);
    for confirmation in 1..4 {
        let again = COMMAND_LONG_DATA { confirmation, ..take_off.clone() };
        assert_eq!(rig.result(&again), MavResult::MAV_RESULT_ACCEPTED, "not refused as in flight");
    }
    rig.fly(2.1);
    assert_eq!(rig.result(&take_off), MavResult::MAV_RESULT_TEMPORARILY_REJECTED, "a new one is");
}

/// As MAVSDK does.
#[test]
fn a_take_off_that_is_sent_again_without_saying_so_is_executed_once_and_acknowledged_twice() {
    let by_command = command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN);
    let by_mode = command_long(MavCmd::MAV_CMD_DO_SET_MODE, [129.0, 4.0, 2.0, NAN, NAN, NAN, NAN]);
    for take_off in [by_command, by_mode] {
        let mut rig = Rig::new();
        let mut encoder = Encoder::new(245, 190);
        let refused = rig.answers(&encoder.encode(&Payload::of(&take_off)));
        assert_eq!(texts(&refused), ["refused: not armed"]);
        let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        rig.answers(&encoder.encode(&Payload::of(&arm)));
        let result = MavResult::MAV_RESULT_ACCEPTED;
        let accepted = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command: take_off.command, result });
        for _ in 0..4 {
            let question = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0; 7]);
            rig.answers(&encoder.encode(&Payload::of(&question)));
            let answers = rig.answers(&encoder.encode(&Payload::of(&take_off)));
            assert_eq!(answers, [accepted.clone(), accepted.clone()], "what was refused before is executed");
            rig.fly(0.5);
        }
        rig.fly(2.0);
        let refused = rig.answers(&encoder.encode(&Payload::of(&take_off)));
        assert_eq!(texts(&refused), ["refused: in flight"]);
    }
}

#[test]
fn a_repetition_whose_original_was_lost_is_executed() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(rig.result(&COMMAND_LONG_DATA { confirmation: 2, ..arm }), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(rig.vehicle.mode(), Mode::Armed);
}

#[test]
fn a_repetition_long_after_is_executed_again() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.result(&arm);
    rig.fly(11.0);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    rig.result(&COMMAND_LONG_DATA { confirmation: 1, ..arm });
    assert_eq!(rig.vehicle.mode(), Mode::Armed);
}

#[test]
fn commands_of_more_senders_than_are_remembered_still_work() {
    let mut rig = Rig::new();
    let disarm = Payload::of(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, DISARM));
    for sender in 200..230 {
        let datagram = Encoder::new(sender, 190).encode(&disarm);
        assert_eq!(rig.answers(&datagram).len(), 1);
    }
}

#[test]
fn a_duplicated_frame_is_one_command() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    let take_off = datagram(&command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN));
    for _ in 0..2 {
        let answers = rig.answers(&take_off);
        let accepted =
            COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_NAV_TAKEOFF, result: MavResult::MAV_RESULT_ACCEPTED };
        assert_eq!(answers, [MavMessage::COMMAND_ACK(accepted)]);
    }
}

#[test]
fn whoever_is_behind_a_link_that_loses_is_answered_twice() {
    let mut rig = Rig::new();
    let mut encoder = Encoder::new(245, 190);
    let mut arm = || encoder.encode(&Payload::of(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM)));
    assert_eq!(rig.answers(&arm()).len(), 1);
    rig.fly(3.0);
    drop(arm());
    assert_eq!(rig.answers(&arm()).len(), 2);
    rig.fly(30.0);
    assert_eq!(rig.answers(&arm()).len(), 1);
}
