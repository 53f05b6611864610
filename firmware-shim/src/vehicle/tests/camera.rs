//! A camera that says where its stream is.

use super::*;
use crate::message::sent::camera::CameraProfile;

const URL: &str = "rtsp://127.0.0.1:8554/camera";

fn carrying() -> Rig {
    let mut rig = Rig::new();
    rig.vehicle.carry_camera(CameraProfile {
        url: URL.to_owned(),
        size: [640, 480],
        rate_hz: 25.0,
        view_angle_deg: 90,
    });
    rig
}

/// The frames of the camera that a command to this component leads to.
fn camera_says(rig: &mut Rig, component: u8, command: MavCmd, first: f32) -> Vec<MavMessage> {
    let request = COMMAND_LONG_DATA {
        target_component: component,
        ..command_long(command, [first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    };
    let mut said = Vec::new();
    rig.vehicle.receive(PEER, &datagram(&request), &mut |frame| said.extend(of_camera(frame)));
    said
}

fn of_camera(frame: &[u8]) -> Option<MavMessage> {
    let parsed = Frames::new(frame).next().unwrap().unwrap();
    (parsed.component == 100).then(|| told(frame).into_iter().next().unwrap())
}

#[test]
fn who_asks_the_camera_is_told_what_it_is_and_where_its_stream_is() {
    let mut rig = carrying();
    let answers = camera_says(&mut rig, 100, MavCmd::MAV_CMD_REQUEST_MESSAGE, 259.0);
    let [MavMessage::CAMERA_INFORMATION(information), MavMessage::COMMAND_ACK(ack)] = &answers[..] else {
        panic!("{answers:?}")
    };
    assert_eq!(ack.result, MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!((information.resolution_h, information.resolution_v), (640, 480));
    assert_eq!(information.flags.bits(), 256, "a video stream, and nothing else");
    assert!(information.vendor_name.starts_with(b"Kestrel\0") && information.focal_length.is_nan());

    let answers = camera_says(&mut rig, 100, MavCmd::MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION, 0.0);
    let [MavMessage::VIDEO_STREAM_INFORMATION(stream), MavMessage::COMMAND_ACK(_)] = &answers[..] else {
        panic!("{answers:?}")
    };
    assert_eq!((stream.framerate, stream.hfov, stream.stream_id, stream.count), (25.0, 90, 1, 1));
    assert_eq!(stream.uri.to_str().unwrap(), URL);
    for (message_id, name) in [
        (0.0, "HEARTBEAT"),
        (260.0, "CAMERA_SETTINGS"),
        (261.0, "STORAGE_INFORMATION"),
        (262.0, "CAMERA_CAPTURE_STATUS"),
        (270.0, "VIDEO_STREAM_STATUS"),
    ] {
        let answers = camera_says(&mut rig, 100, MavCmd::MAV_CMD_REQUEST_MESSAGE, message_id);
        assert_eq!(mavlink::Message::message_name(&answers[0]), name);
    }
}

#[test]
fn the_camera_answers_what_is_meant_for_it_alone() {
    let mut rig = carrying();
    let result = |answers: &[MavMessage]| match answers {
        [MavMessage::COMMAND_ACK(answer)] => answer.result,
        answers => panic!("{answers:?}"),
    };
    let denied = camera_says(&mut rig, 100, MavCmd::MAV_CMD_REQUEST_MESSAGE, 30.0);
    assert_eq!(result(&denied), MavResult::MAV_RESULT_DENIED);
    let unsupported = camera_says(&mut rig, 100, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0);
    assert_eq!(result(&unsupported), MavResult::MAV_RESULT_UNSUPPORTED);
    let started = camera_says(&mut rig, 100, MavCmd::MAV_CMD_VIDEO_START_STREAMING, 0.0);
    assert_eq!(result(&started), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    for component in [0, 1, 101] {
        assert_eq!(camera_says(&mut rig, component, MavCmd::MAV_CMD_REQUEST_MESSAGE, 259.0), []);
    }
    assert_eq!(camera_says(&mut Rig::new(), 100, MavCmd::MAV_CMD_REQUEST_MESSAGE, 259.0), [], "there is none");
}

#[test]
fn its_heart_beats_once_a_second_with_numbers_of_its_own() {
    let mut rig = carrying();
    let mut beats = Vec::new();
    for _ in 0..(3.0 / rig.vehicle.control_period().as_secs_f32()).round() as u32 {
        rig.vehicle.tick(rig.plant.state(), &[PEER], &mut |_, frame| {
            if of_camera(frame).is_some() {
                beats.push((frame[4], of_camera(frame).unwrap()));
            }
        });
    }
    let numbers: Vec<u8> = beats.iter().map(|(sequence, _)| *sequence).collect();
    assert_eq!(numbers, [0, 1, 2]);
    assert!(beats.iter().all(|(_, beat)| matches!(beat, MavMessage::HEARTBEAT(_))), "{beats:?}");
}
