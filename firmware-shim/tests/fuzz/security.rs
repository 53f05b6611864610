//! A vehicle that wants signatures, and forgers.

use kestrel_onboard::signature::{SIGNATURE_LEN, SignatureTime, Signer, SigningKey};
use kestrel_onboard::signature_guard::SignatureGuard;
use kestrel_shim::autopilot::Mode;
use kestrel_shim::frame::{Frame, FrameVersion, Frames};

use crate::corpus;
use crate::draft::{FrameDraft, SIGNED, Seal};
use crate::effort::{self, Effort};
use crate::random::Random;
use crate::rig::Rig;

const FORGERIES: u64 = 100_000;

/// Forgeries between two control periods.
const PER_TICK: u64 = 32;

const KEY: SigningKey = SigningKey([7; 32]);

/// What was accepted before the vehicle's last start, ten minutes ago on the clock.
const FLOOR: SignatureTime = SignatureTime(1_000_000_000);
const NOW: SignatureTime = SignatureTime(FLOOR.0 + 10 * MINUTE);

const MINUTE: u64 = 60 * 100_000;

const GROUND_STATION: [u8; 2] = [255, 190];

const ARM: [f32; 7] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
const LEFT_OPEN: [f32; 7] = [f32::NAN; 7];

/// Ways to get a frame past the signature.
#[derive(Clone, Copy, Debug)]
enum Forgery {
    /// None at all, in the present protocol.
    Unsigned,
    /// In the old one.
    OldProtocol,
    /// Of another key.
    OtherKey,
    /// Of another frame, whose time has not been seen yet.
    Transplanted,
    /// Any bytes.
    Guessed,
    /// A good frame that was accepted before.
    Replayed,
    /// A good frame from a sender that is new, more than a minute old.
    Stale,
    /// A good frame from before the last start, of a sender that is new.
    FromBefore,
    /// A good frame, as new as can be, of which one bit is another one, checksum repaired.
    Altered,
}

impl Forgery {
    const ALL: [Self; 9] = [
        Self::Unsigned,
        Self::OldProtocol,
        Self::OtherKey,
        Self::Transplanted,
        Self::Guessed,
        Self::Replayed,
        Self::Stale,
        Self::FromBefore,
        Self::Altered,
    ];
}

/// A ground station that has the key.
struct Client {
    time: u64,
    accepted: Vec<Vec<u8>>,
}

impl Client {
    fn command(&mut self, command: u16, parameters: [f32; 7]) -> Vec<u8> {
        let mut payload: Vec<u8> = parameters.iter().flat_map(|parameter| parameter.to_le_bytes()).collect();
        payload.extend(command.to_le_bytes());
        payload.extend([1, 1, 0]);
        self.time += 1;
        let mut bytes = Vec::new();
        let seal = Seal::Of(KEY, 0, SignatureTime(self.time));
        draft(GROUND_STATION, 76, &payload).write(0, &seal, &mut bytes);
        self.accepted.push(bytes.clone());
        bytes
    }
}

fn draft(sender: [u8; 2], message_id: u32, payload: &[u8]) -> FrameDraft<'_> {
    FrameDraft { version: FrameVersion::V2, flags: SIGNED, sequence: 0, sender, message_id, payload }
}

/// Commands, parameters, missions, set-points and more, as clients send them, forged.
struct Forger {
    random: Random,
    models: Vec<Frame<'static>>,
    loot: Vec<Vec<u8>>,
    time: u64,
}

impl Forger {
    fn next(&mut self) -> Vec<u8> {
        let forgery = self.random.pick(&Forgery::ALL);
        self.time += 1;
        let mut bytes = Vec::new();
        let model = self.random.pick(&self.models);
        let whole = draft(GROUND_STATION, model.message_id, model.payload);
        let stranger = FrameDraft { sender: [self.random.byte().max(2), 7], ..whole };
        let old = |age: u64| Seal::Of(KEY, 9, SignatureTime(NOW.0 - age));
        let no_seal = Seal::Bytes([0; SIGNATURE_LEN]);
        match forgery {
            Forgery::Unsigned => FrameDraft { flags: 0, ..whole }.write(0, &no_seal, &mut bytes),
            Forgery::OldProtocol if whole.message_id < 256 => {
                FrameDraft { version: FrameVersion::V1, flags: 0, ..whole }.write(0, &no_seal, &mut bytes);
            }
            Forgery::OtherKey | Forgery::OldProtocol => {
                let mut key = KEY;
                key.0[self.random.below(32)] ^= 1 << self.random.below(8);
                whole.write(0, &Seal::Of(key, 0, SignatureTime(self.time)), &mut bytes);
            }
            Forgery::Transplanted => self.transplant(&whole, &mut bytes),
            Forgery::Guessed => {
                let mut signature = [0; SIGNATURE_LEN];
                self.random.fill(&mut signature);
                whole.write(0, &Seal::Bytes(signature), &mut bytes);
            }
            Forgery::Replayed => {
                let at = self.random.below(self.loot.len());
                bytes.clone_from(&self.loot[at]);
            }
            Forgery::Stale => stranger.write(0, &old(MINUTE + 1 + self.random.next() % MINUTE), &mut bytes),
            Forgery::FromBefore => stranger.write(0, &old(10 * MINUTE + self.random.next() % MINUTE), &mut bytes),
            Forgery::Altered => self.alter(&whole, &mut bytes),
        }
        assert!(Frames::new(&bytes).all(|frame| frame.is_ok()), "only the signature is wrong");
        bytes
    }

    /// Gives a frame the signature of another.
    fn transplant(&mut self, whole: &FrameDraft, bytes: &mut Vec<u8>) {
        let mut other = Vec::new();
        let payload = self.random.next().to_le_bytes();
        draft(GROUND_STATION, 0, &payload).write(0, &Seal::Of(KEY, 0, SignatureTime(self.time)), &mut other);
        let signature = other[other.len() - SIGNATURE_LEN..].try_into().expect("a signature");
        whole.write(0, &Seal::Bytes(signature), bytes);
    }

    /// Flips a bit of the payload, the sequence or the sender.
    fn alter(&mut self, whole: &FrameDraft, bytes: &mut Vec<u8>) {
        let mut signed = Vec::new();
        whole.write(0, &Seal::Of(KEY, 0, SignatureTime(self.time)), &mut signed);
        let signature = signed[signed.len() - SIGNATURE_LEN..].try_into().expect("a signature");
        let bit = 1 << self.random.below(8);
        let mut payload = whole.payload.to_vec();
        let mut altered = FrameDraft { sequence: whole.sequence ^ bit, ..*whole };
        if !payload.is_empty() && !self.random.one_in(4) {
            let at = self.random.below(payload.len());
            payload[at] ^= bit;
            altered = FrameDraft { payload: &payload, ..*whole };
        }
        altered.write(0, &Seal::Bytes(signature), bytes);
    }
}

/// Identifier of the message that tells how many frames were refused.
const SYS_STATUS: [u8; 3] = [1, 0, 0];

/// Two vehicles that have heard the same from who has the key.
struct Pair {
    attacked: Box<Rig>,
    left_alone: Box<Rig>,
    client: Client,
}

impl Pair {
    fn new() -> Self {
        let rig = || {
            let mut rig = Box::new(Rig::signing(&KEY, FLOOR));
            rig.vehicle.advance_clock(NOW);
            rig
        };
        let client = Client { time: NOW.0, accepted: Vec::new() };
        Self { attacked: rig(), left_alone: rig(), client }
    }

    fn handle(&mut self, command: u16, parameters: [f32; 7]) {
        let bytes = self.client.command(command, parameters);
        for rig in [&mut self.attacked, &mut self.left_alone] {
            assert!(rig.receive(&bytes), "who has the key is heard");
        }
    }

    /// A control period, in which the two are the same to the bit but for the number of refused frames.
    fn tick(&mut self) {
        let [attacked, left_alone] = [&mut self.attacked, &mut self.left_alone].map(|rig| {
            let mut bytes: Vec<u8> = Vec::new();
            let targets = rig.tick(&mut |frame| {
                if frame[7..10] != SYS_STATUS {
                    bytes.extend(frame);
                }
            });
            (bytes, targets, rig.vehicle.mode(), rig.vehicle.signature_times())
        });
        assert!(attacked == left_alone, "an answer, or another flight");
    }
}

#[test]
fn of_a_hundred_thousand_forgeries_none_is_heard() {
    let mut pair = Pair::new();
    pair.handle(400, ARM);
    let time = pair.client.time + MINUTE;
    let loot = pair.client.accepted.clone();
    let mut forger = Forger { random: Random::new(effort::seed()), models: corpus::frames(), loot, time };
    let effort = Effort::begin();
    for number in 0..FORGERIES {
        if number == FORGERIES / 10 {
            pair.handle(400, ARM);
            pair.handle(22, LEFT_OPEN);
            forger.loot.clone_from(&pair.client.accepted);
        }
        assert!(!pair.attacked.receive(&forger.next()), "a forgery is heard");
        if number % PER_TICK == 0 {
            pair.tick();
        }
    }
    effort.end(FORGERIES, "forgeries");
    assert_eq!(pair.attacked.vehicle.counts().refused, FORGERIES);
    assert_eq!(pair.attacked.vehicle.parameters(), pair.left_alone.vehicle.parameters());
    assert_eq!(pair.attacked.vehicle.mode(), Mode::Holding);
    pair.handle(21, LEFT_OPEN);
    assert_eq!(pair.attacked.vehicle.mode(), Mode::Landing);
}

#[test]
fn without_the_key_nobody_is_heard() {
    let mut rig = Rig::new();
    rig.vehicle.secure(SignatureGuard::Closed, Signer::new(KEY, 0, NOW));
    let mut client = Client { time: NOW.0, accepted: Vec::new() };
    assert!(!rig.receive(&client.command(400, ARM)));
    for frame in corpus::frames() {
        assert!(!rig.receive(frame.bytes));
    }
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    assert_eq!(rig.vehicle.counts().refused, 1 + corpus::frames().len() as u64);
}
