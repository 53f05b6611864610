//! Both ends of a line that is two queues.

use std::collections::VecDeque;
use std::vec::Vec;

use super::*;
use crate::policy_file::{Aligned, PolicyFile};

/// A line whose other end has said everything already.
#[derive(Default)]
struct QueuePort {
    incoming: VecDeque<u8>,
    outgoing: Vec<u8>,
}

impl SerialPort for QueuePort {
    fn read(&mut self) -> Option<u8> {
        self.incoming.pop_front()
    }

    fn write(&mut self, byte: u8) {
        self.outgoing.push(byte);
    }
}

fn frame(kind: MessageKind, payload: &[u8]) -> Vec<u8> {
    let mut line = QueuePort::default();
    send(&mut line, kind, &[payload]);
    line.outgoing
}

/// What is answered to `asked`, frame by frame.
fn answers(asked: &[Vec<u8>]) -> Vec<(MessageKind, Vec<u8>)> {
    let mut line = QueuePort { incoming: asked.iter().flatten().copied().collect(), outgoing: Vec::new() };
    serve(&mut line, &mut Aligned([0; 16_384]).0);
    let mut back = QueuePort { incoming: line.outgoing.into(), outgoing: Vec::new() };
    let mut answers = Vec::new();
    while let Some(head) = MessageHeader::receive(&mut back) {
        let mut room = [0; 64];
        let payload = head.receive_payload(&mut back, &mut room).unwrap().unwrap().to_vec();
        answers.push((head.kind().unwrap(), payload));
    }
    assert_eq!(answers.remove(0), code(NO_POLICY), "it is there");
    answers
}

fn code(code: i32) -> (MessageKind, Vec<u8>) {
    (MessageKind::Code, code.to_le_bytes().to_vec())
}

const HOVER: &[u8] = &Aligned(*include_bytes!("../../../assets/pilots/hover.kestrel")).0;
const CROSS: &[u8] = &Aligned(*include_bytes!("../../../assets/pilots/cross.kestrel")).0;

fn state(step: u8) -> State<f32> {
    let wave = |phase: u8| 0.2 * libm::sinf(f32::from(step) + f32::from(phase));
    State {
        position: Vector3::new(wave(0), wave(1), 1.0 + wave(2)),
        world_from_body: Attitude { w: 1.0, x: 0.1 * wave(3), y: 0.1 * wave(4), z: 0.1 * wave(5) },
        velocity: Vector3::new(wave(6), wave(7), wave(8)),
        body_rates: Vector3::new(wave(9), wave(10), wave(11)),
        rotor_speeds: [0.0; 4],
    }
}

#[test]
fn a_pilot_on_another_processor_is_the_pilot() {
    for file in [HOVER, CROSS] {
        let mut pilot = Pilot::new(PolicyFile::parse(file).unwrap());
        let goal = Vector3::new(0.1, 0.2, 1.0);
        let measured = pilot.policy().metadata().observation.measured_len();
        let mut asked = std::vec![frame(MessageKind::Policy, file)];
        let mut expected = std::vec![code(0)];
        for step in 0..40 {
            if step == 10 {
                asked.push(frame(MessageKind::Test, &[]));
                expected.push(code(0));
            }
            if step == 20 {
                asked.push(frame(MessageKind::Reset, &[]));
                expected.push(code(0));
                pilot.reset();
            }
            let measurements: Vec<f32> = (0..measured).map(|index| 0.05 * index as f32).collect();
            let mut payload =
                tick_payload(&state(step), &Setpoint { yaw: 0.4, ..Setpoint::at(goal) }).as_flattened().to_vec();
            payload.extend(measurements.iter().flat_map(|value| value.to_le_bytes()));
            asked.push(frame(MessageKind::Tick, &payload));
            let targets =
                pilot.tick_towards(&measurements, &state(step), &Setpoint { yaw: 0.4, ..Setpoint::at(goal) });
            expected
                .push((MessageKind::Targets, targets.iter().flat_map(|target| target.to_le_bytes()).collect()));
        }
        assert_eq!(answers(&asked), expected);
    }
}

#[test]
fn what_is_wrong_gets_a_number_and_the_line_goes_on() {
    let mut damaged = frame(MessageKind::Tick, &[0; 64]);
    damaged[10] ^= 1;
    let mut unknown = frame(MessageKind::Reset, &[]);
    unknown[1] = 77;
    let tick =
        || frame(MessageKind::Tick, tick_payload(&state(0), &Setpoint::at(Vector3::zeros())).as_flattened());
    let mut altered = HOVER.to_vec();
    *altered.last_mut().unwrap() ^= 1;
    let asked = [
        tick(),
        frame(MessageKind::Test, &[]),
        frame(MessageKind::Policy, &HOVER[..100]),
        frame(MessageKind::Policy, &altered),
        frame(MessageKind::Policy, &std::vec![0; 20_000]),
        tick(),
        b"noise".to_vec(),
        frame(MessageKind::Policy, HOVER),
        damaged,
        unknown,
        frame(MessageKind::Tick, &[0; 63]),
        frame(MessageKind::Tick, &[0; 72]),
        frame(MessageKind::Tick, &[0; 9_000]),
        frame(MessageKind::Targets, &[]),
        frame(MessageKind::Reset, &[]),
    ];
    let expected =
        [NO_POLICY, NO_POLICY, 1, 6, LENGTH, NO_POLICY, 0, DAMAGED, DAMAGED, LENGTH, LENGTH, LENGTH, DAMAGED, 0];
    assert_eq!(answers(&asked), expected.map(code));
}

#[test]
fn a_line_that_goes_ends_the_service() {
    let all = [frame(MessageKind::Policy, HOVER), frame(MessageKind::Reset, &[])].concat();
    for len in [0, 1, 3, 100, HOVER.len(), all.len() - 1] {
        let mut line = QueuePort { incoming: all[..len].iter().copied().collect(), outgoing: Vec::new() };
        serve(&mut line, &mut Aligned([0; 16_384]).0);
        assert!(line.incoming.is_empty());
    }
}
