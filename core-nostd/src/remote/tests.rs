//! Both ends of a line that is two queues.

use std::collections::VecDeque;
use std::vec::Vec;

use super::*;
use crate::policy_file::Aligned;

/// A line whose other end has said everything already.
#[derive(Default)]
struct Line {
    incoming: VecDeque<u8>,
    outgoing: Vec<u8>,
}

impl Port for Line {
    fn read(&mut self) -> Option<u8> {
        self.incoming.pop_front()
    }

    fn write(&mut self, byte: u8) {
        self.outgoing.push(byte);
    }
}

fn frame(kind: Kind, payload: &[u8]) -> Vec<u8> {
    let mut line = Line::default();
    send(&mut line, kind, &[payload]);
    line.outgoing
}

/// What is answered to `asked`, frame by frame.
fn answers(asked: &[Vec<u8>]) -> Vec<(Kind, Vec<u8>)> {
    let mut line = Line { incoming: asked.iter().flatten().copied().collect(), outgoing: Vec::new() };
    serve(&mut line, &mut Aligned([0; 16_384]).0);
    let mut back = Line { incoming: line.outgoing.into(), outgoing: Vec::new() };
    let mut answers = Vec::new();
    while let Some(head) = Head::receive(&mut back) {
        let mut room = [0; 64];
        let payload = head.receive_payload(&mut back, &mut room).unwrap().unwrap().to_vec();
        answers.push((head.kind().unwrap(), payload));
    }
    assert_eq!(answers.remove(0), code(NO_POLICY), "it is there");
    answers
}

fn code(code: i32) -> (Kind, Vec<u8>) {
    (Kind::Code, code.to_le_bytes().to_vec())
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
fn a_remote_pilot_is_the_pilot() {
    for file in [HOVER, CROSS] {
        let mut pilot = Pilot::new(PolicyFile::parse(file).unwrap());
        let goal = Vector3::new(0.1, 0.2, 1.0);
        let measured = pilot.policy().metadata().observation.measured_len();
        let mut asked = std::vec![frame(Kind::Policy, file)];
        let mut expected = std::vec![code(0)];
        for step in 0..40 {
            if step == 10 {
                asked.push(frame(Kind::Test, &[]));
                expected.push(code(0));
            }
            if step == 20 {
                asked.push(frame(Kind::Reset, &[]));
                expected.push(code(0));
                pilot.reset();
            }
            let measurements: Vec<f32> = (0..measured).map(|index| 0.05 * index as f32).collect();
            let mut payload = tick_payload(&state(step), &goal).as_flattened().to_vec();
            payload.extend(measurements.iter().flat_map(|value| value.to_le_bytes()));
            asked.push(frame(Kind::Tick, &payload));
            let targets = pilot.tick_measured(&measurements, &state(step), &goal);
            expected.push((Kind::Targets, targets.iter().flat_map(|target| target.to_le_bytes()).collect()));
        }
        assert_eq!(answers(&asked), expected);
    }
}

#[test]
fn what_is_wrong_gets_a_number_and_the_line_goes_on() {
    let mut damaged = frame(Kind::Tick, &[0; 64]);
    damaged[10] ^= 1;
    let mut unknown = frame(Kind::Reset, &[]);
    unknown[1] = 77;
    let tick = || frame(Kind::Tick, tick_payload(&state(0), &Vector3::zeros()).as_flattened());
    let mut altered = HOVER.to_vec();
    *altered.last_mut().unwrap() ^= 1;
    let asked = [
        tick(),
        frame(Kind::Test, &[]),
        frame(Kind::Policy, &HOVER[..100]),
        frame(Kind::Policy, &altered),
        frame(Kind::Policy, &std::vec![0; 20_000]),
        tick(),
        b"noise".to_vec(),
        frame(Kind::Policy, HOVER),
        damaged,
        unknown,
        frame(Kind::Tick, &[0; 63]),
        frame(Kind::Tick, &[0; 68]),
        frame(Kind::Tick, &[0; 9_000]),
        frame(Kind::Targets, &[]),
        frame(Kind::Reset, &[]),
    ];
    let expected =
        [NO_POLICY, NO_POLICY, 1, 6, LENGTH, NO_POLICY, 0, DAMAGED, DAMAGED, LENGTH, LENGTH, LENGTH, DAMAGED, 0];
    assert_eq!(answers(&asked), expected.map(code));
}

#[test]
fn a_line_that_goes_ends_the_service() {
    let all = [frame(Kind::Policy, HOVER), frame(Kind::Reset, &[])].concat();
    for len in [0, 1, 3, 100, HOVER.len(), all.len() - 1] {
        let mut line = Line { incoming: all[..len].iter().copied().collect(), outgoing: Vec::new() };
        serve(&mut line, &mut Aligned([0; 16_384]).0);
        assert!(line.incoming.is_empty());
    }
}
