//! What is told without being asked, and how often.

use kestrel_core::airframe::GRAVITY;

use super::*;

/// What two who listen are told in a second after a datagram of [`ANOTHER`], and what that one is answered.
fn told_to_both(rig: &mut Rig, datagram: &[u8]) -> ([Vec<Vec<u8>>; 2], Vec<Vec<u8>>) {
    let (mut told, mut answers) = ([const { Vec::new() }; 2], Vec::new());
    rig.vehicle.receive(ANOTHER, datagram, &mut |frame| answers.push(frame.to_vec()));
    for _ in 0..100 {
        rig.vehicle.tick(rig.plant.state(), &[PEER, ANOTHER], &mut |peer, frame| {
            told[usize::from(peer == ANOTHER)].push(frame.to_vec());
        });
    }
    (told, answers)
}

fn count(frames: &[Vec<u8>], message_id: u32) -> usize {
    frames.iter().filter(|bytes| Frames::new(bytes).flatten().any(|frame| frame.message_id == message_id)).count()
}

#[test]
fn telemetry_is_timed_by_the_simulation() {
    let mut rig = Rig::new();
    rig.heard.clear();
    rig.fly(10.0);
    let count = |id| rig.heard.iter().filter(|message| mavlink::Message::message_id(*message) == id).count();
    assert_eq!([0, 1, 245, 30, 32].map(count), [10, 10, 20, 500, 500]);
}

#[test]
fn streams_can_be_set_and_versions_asked_for() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [30.0, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.refused(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [23.0; 7], MavResult::MAV_RESULT_DENIED);
    rig.heard.clear();
    rig.fly(10.0);
    let attitudes = rig.heard.iter().filter(|message| matches!(message, MavMessage::ATTITUDE(_))).count();
    assert_eq!(attitudes, 10);
    let request = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let answers = rig.answers(&datagram(&request));
    assert!(answers.iter().any(|answer| matches!(answer, MavMessage::AUTOPILOT_VERSION(_))), "{answers:?}");
}

#[test]
fn everybody_has_intervals_of_their_own_and_numbers_without_a_gap() {
    let mut rig = Rig::new();
    let off = command_long(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let ([first, second], answers) = told_to_both(&mut rig, &datagram(&off));
    assert_eq!((count(&answers, 77), count(&first, 77), count(&second, 77)), (1, 0, 0), "who asked is answered");
    assert_eq!((count(&first, 0), count(&second, 0)), (1, 0), "a heartbeat");
    let once = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [0.0; 7]);
    let ([third, fourth], more_answers) = told_to_both(&mut rig, &datagram(&once));
    assert_eq!((count(&third, 0), count(&fourth, 0)), (1, 1), "one that was asked for");
    let asked = command_long(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, [0.0; 7]);
    let ([fifth, sixth], last_answers) = told_to_both(&mut rig, &datagram(&asked));
    let interval = last_answers.iter().filter_map(|bytes| told(bytes)).find_map(|message| match message {
        MavMessage::MESSAGE_INTERVAL(interval) => Some(interval.interval_us),
        _ => None,
    });
    assert_eq!(interval, Some(-1));
    let ours = [first, third, fifth].concat();
    let theirs = [answers, second, more_answers, fourth, last_answers, sixth].concat();
    for frames in [ours, theirs] {
        let numbers: Vec<u8> = frames.iter().map(|frame| frame[4]).collect();
        assert!(numbers.windows(2).all(|pair| pair[1] == pair[0].wrapping_add(1)), "{numbers:?}");
    }
}

#[test]
fn an_imu_at_rest_feels_gravity_and_rangers_are_told_once_they_measure() {
    let mut rig = Rig::new();
    let only = |what: fn(&MavMessage) -> bool, rig: &mut Rig| {
        rig.heard.clear();
        for _ in 0..100 {
            if rig.vehicle.wants_ranges() {
                let [front, back, left, right, up, down] = [Some(1.5), None, None, None, None, Some(0.02)];
                rig.vehicle.note_ranges(Some(Ranges { front, back, left, right, up, down }));
            }
            rig.tick();
        }
        rig.heard.drain(..).filter(what).collect::<Vec<_>>()
    };
    let felt = only(|message| matches!(message, MavMessage::HIGHRES_IMU(_)), &mut rig);
    assert!(!felt.is_empty());
    for message in felt {
        let MavMessage::HIGHRES_IMU(imu) = message else { unreachable!() };
        assert!((imu.zacc + GRAVITY as f32).abs() < 1e-3 && imu.xacc.abs() < 1e-3, "{imu:?}");
    }
    let told = only(|message| matches!(message, MavMessage::DISTANCE_SENSOR(_)), &mut rig);
    let distances: Vec<(u8, u16)> = told[..6]
        .iter()
        .map(|message| match message {
            MavMessage::DISTANCE_SENSOR(told) => (told.orientation as u8, told.current_distance),
            _ => unreachable!(),
        })
        .collect();
    assert_eq!(distances, [(0, 150), (4, 401), (6, 401), (2, 401), (24, 401), (25, 2)]);
}

#[test]
fn who_comes_anew_has_the_default_intervals() {
    let mut rig = Rig::new();
    let off = command_long(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.receive(&datagram(&off));
    let heartbeats = |rig: &mut Rig, peer: Peer| {
        let mut frames = Vec::new();
        for _ in 0..100 {
            rig.vehicle.tick(rig.plant.state(), &[peer], &mut |_, frame| frames.push(frame.to_vec()));
        }
        count(&frames, 0)
    };
    assert_eq!(heartbeats(&mut rig, PEER), 0);
    let anew = Peer { endpoint: EndpointId { generation: 1, ..EndpointId::ONLY }, ..PEER };
    assert_eq!(heartbeats(&mut rig, anew), 1);
    assert_eq!(heartbeats(&mut rig, PEER), 1, "it was gone");
}

#[test]
fn a_message_requested_a_hundred_times_in_a_period_is_told_once() {
    let mut rig = Rig::new();
    // In turn with another one, so that none is a repetition of the one before it.
    for id in [141.0, 242.0].repeat(100) {
        let request = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [id, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        rig.receive(&datagram(&request));
    }
    rig.heard.clear();
    rig.tick();
    let altitudes = rig.heard.iter().filter(|message| matches!(message, MavMessage::ALTITUDE(_))).count();
    assert_eq!(altitudes, 1);
}
