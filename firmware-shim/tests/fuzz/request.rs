//! Whole frames with any payload, of all messages that a vehicle obeys.

use kestrel_onboard::signature::{SIGNATURE_LEN, SignatureTime, SigningKey};
use kestrel_shim::frame::{FrameVersion, Frames};
use kestrel_shim::parameter::table::Parameter;

use crate::draft::{FrameDraft, SIGNED, Seal};
use crate::random::Random;

/// The vehicle's address.
pub(crate) const VEHICLE: [u8; 2] = [1, 1];

/// Who sends: more than the vehicle remembers the last command of.
const SENDERS: [[u8; 2]; 6] = [[255, 190], [254, 190], [245, 190], [253, 190], [1, 191], [1, 1]];

/// Second parameter of a disarm command that works in flight.
const FORCED: f32 = 21196.0;

/// A message that the vehicle obeys: where in its payload whose address stands, and which command.
struct Form {
    message_id: u32,
    len: usize,
    system_at: Option<usize>,
    component_at: Option<usize>,
    command_at: Option<usize>,
}

const fn form(message_id: u32, len: usize, system_at: usize) -> Form {
    Form { message_id, len, system_at: Some(system_at), component_at: Some(system_at + 1), command_at: None }
}

const fn commanding(message_id: u32, len: usize, command_at: usize, system_at: usize) -> Form {
    Form { command_at: Some(command_at), ..form(message_id, len, system_at) }
}

const FORMS: [Form; 25] = [
    Form { message_id: 0, len: 9, system_at: None, component_at: None, command_at: None },
    form(4, 14, 12),
    Form { message_id: 11, len: 6, system_at: Some(4), component_at: None, command_at: None },
    form(20, 20, 2),
    form(21, 2, 0),
    form(23, 23, 4),
    form(37, 7, 4),
    form(38, 7, 4),
    commanding(39, 38, 30, 32),
    form(40, 5, 2),
    form(41, 4, 2),
    form(43, 3, 0),
    form(44, 9, 2),
    form(45, 3, 0),
    form(47, 8, 0),
    form(51, 5, 2),
    commanding(73, 38, 30, 32),
    commanding(75, 35, 28, 30),
    commanding(76, 33, 28, 30),
    form(82, 39, 36),
    form(84, 53, 50),
    form(86, 53, 50),
    form(110, 254, 1),
    form(111, 18, 16),
    // No vehicle handles this one.
    Form { message_id: 69, len: 11, system_at: Some(10), component_at: None, command_at: None },
];

/// What stands in a word of a payload more often than chance would have it.
const FLOATS: [f32; 20] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-40,
    -0.0,
    0.0,
    1.0,
    1.0,
    -1.0,
    2.0,
    0.3,
    -0.5,
    129.0,
    4.0,
    6.0,
    FORCED,
    47.397_742,
];
const INTEGERS: [u32; 8] = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 473_977_420, 85_455_940, 0x0006_0000];

const COMMANDS: [u16; 26] = [
    16, 17, 19, 20, 21, 22, 93, 112, 176, 178, 185, 192, 193, 207, 300, 400, 400, 410, 511, 512, 520, 530, 5001,
    5003, 5004, 5100,
];

/// How a frame is sealed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sealing {
    Unsigned,
    Right,
    Wrong,
}

/// A datagram, and what it may do.
#[derive(Debug, Default)]
pub(crate) struct Request {
    pub(crate) datagram: Vec<u8>,
    /// Whether the vehicle may obey it.
    pub(crate) admissible: bool,
    /// Whether it is a command to arm.
    pub(crate) arms: bool,
    /// Whether it is one to stop the motors, in flight too.
    pub(crate) stops: bool,
}

/// Makes them.
pub(crate) struct Requests {
    random: Random,
    /// What signs, if signatures are wanted.
    key: Option<SigningKey>,
    time: u64,
    sequence: u8,
    sender: [u8; 2],
    payload: Vec<u8>,
    request: Request,
}

impl Requests {
    pub(crate) fn new(seed: u64, key: Option<SigningKey>) -> Self {
        Self {
            random: Random::new(seed),
            key,
            time: 1,
            sequence: 0,
            sender: SENDERS[0],
            payload: Vec::with_capacity(256),
            request: Request { datagram: Vec::with_capacity(1024), ..Request::default() },
        }
    }

    /// Latest time of a signature.
    pub(crate) const fn now(&self) -> SignatureTime {
        SignatureTime(self.time)
    }

    /// Any; what stops the motors is rarer than chance would have it, as it ends flights.
    pub(crate) fn any(&mut self) -> &Request {
        self.make();
        while self.request.stops && !self.random.one_in(16) {
            self.make();
        }
        &self.request
    }

    fn make(&mut self) {
        let form = &FORMS[self.random.below(FORMS.len())];
        self.write_payload(form);
        let sealing = match self.key {
            None => self.random.pick(&[Sealing::Unsigned, Sealing::Wrong]),
            Some(_) => self.random.pick(&[Sealing::Unsigned, Sealing::Wrong, Sealing::Right, Sealing::Right]),
        };
        let hidden = self.random.one_in(8);
        self.request.admissible =
            !hidden && self.is_for_vehicle(form) && (self.key.is_none() || sealing == Sealing::Right);
        self.judge(form);
        self.sender = self.random.pick(&SENDERS);
        self.frame(form.message_id, sealing);
        if hidden {
            self.hide();
        }
    }

    /// `COMMAND_LONG`, to the vehicle.
    pub(crate) fn command(&mut self, command: u16, parameters: [f32; 7]) -> &Request {
        self.payload.clear();
        self.payload.extend(parameters.iter().flat_map(|parameter| parameter.to_le_bytes()));
        self.payload.extend(command.to_le_bytes());
        self.payload.extend(VEHICLE);
        self.payload.push(0);
        self.meant(&commanding(76, 33, 28, 30))
    }

    /// `MISSION_COUNT`, of a mission.
    pub(crate) fn count(&mut self, items: u8) -> &Request {
        self.payload.clear();
        self.payload.extend([items, 0, VEHICLE[0], VEHICLE[1]]);
        self.meant(&form(44, 9, 2))
    }

    /// `MISSION_ITEM_INT`, of a mission: within two metres of the origin, of any kind, and seldom nonsense.
    pub(crate) fn item(&mut self, sequence: u8) -> &Request {
        self.payload.clear();
        for _ in 0..4 {
            let nonsense = self.random.one_in(32);
            let parameter = if nonsense { self.random.pick(&FLOATS) } else { self.random.below(3) as f32 * 0.5 };
            self.payload.extend(parameter.to_le_bytes());
        }
        for _ in 0..2 {
            let steps = self.random.below(40_001) as i32 - 20_000;
            self.payload.extend(steps.to_le_bytes());
        }
        let down = if self.random.one_in(32) { self.random.pick(&FLOATS) } else { -1.0 };
        self.payload.extend(down.to_le_bytes());
        self.payload.extend([sequence, 0]);
        let command: u16 = self.random.pick(&[16, 16, 16, 17, 19, 20, 21, 22, 93, 112, 178, 205]);
        self.payload.extend(command.to_le_bytes());
        self.payload.extend([VEHICLE[0], VEHICLE[1], 1, 0, 1, 0]);
        self.meant(&commanding(73, 38, 30, 32))
    }

    fn meant(&mut self, form: &Form) -> &Request {
        self.request.admissible = true;
        self.judge(form);
        self.sender = SENDERS[0];
        self.frame(form.message_id, if self.key.is_some() { Sealing::Right } else { Sealing::Unsigned });
        &self.request
    }

    fn write_payload(&mut self, form: &Form) {
        self.payload.clear();
        self.payload.resize(form.len.next_multiple_of(4), 0);
        for word in self.payload.chunks_exact_mut(4) {
            let value = match self.random.below(8) {
                0..=3 => self.random.pick(&FLOATS).to_bits(),
                4 => ((self.random.below(4001) as f32 - 2000.0) * 1e-3).to_bits(),
                5 => self.random.pick(&INTEGERS),
                _ => self.random.next() as u32,
            };
            word.copy_from_slice(&value.to_le_bytes());
        }
        self.payload.truncate(form.len);
        if !self.random.one_in(4) {
            self.make_sensible(form);
        }
        let address =
            self.random.pick(&[VEHICLE, VEHICLE, VEHICLE, [1, 0], [0, 0], [0, 1], [2, 1], [1, 2], [255, 190]]);
        for (at, part) in [form.system_at, form.component_at].into_iter().zip(address) {
            if let Some(at) = at {
                self.payload[at] = part;
            }
        }
        // Trailing bytes may be left out, zero or not.
        if self.random.one_in(16) {
            let len = self.random.below(form.len + 1);
            self.payload.truncate(len);
        }
    }

    /// What a client might have meant, so that more than the first check is passed.
    fn make_sensible(&mut self, form: &Form) {
        if let Some(at) = form.command_at {
            let command = self.random.pick(&COMMANDS);
            self.payload[at..at + 2].copy_from_slice(&command.to_le_bytes());
        }
        let small = self.random.below(5) as u8;
        let plan = self.random.pick(&[0, 0, 0, 1, 2, 255]);
        match form.message_id {
            0 => self.payload[4] = 6,
            20 | 23 => self.name_parameter(form.message_id),
            39 | 73 => {
                self.payload[28..30].copy_from_slice(&[small, 0]);
                (self.payload[34], self.payload[36], self.payload[37]) =
                    (self.random.pick(&[3, 6, 1, 0]), 1, plan);
            }
            40 | 44 | 51 => {
                self.payload[..2].copy_from_slice(&[small, 0]);
                self.payload[4] = plan;
            }
            41 => self.payload[..2].copy_from_slice(&[small, 0]),
            43 | 45 => self.payload[2] = plan,
            75 => self.payload[32] = self.random.pick(&[0, 1, 3, 6]),
            82 => self.payload[38] = self.random.pick(&[0x07, 0x80, 0x47]),
            84 | 86 => {
                let mask: u16 = self.random.pick(&[0b1101_1111_1000, 0b1101_1100_0111, 0b1001_1100_0111]);
                self.payload[48..50].copy_from_slice(&mask.to_le_bytes());
                self.payload[52] = if form.message_id == 84 { 1 } else { self.random.pick(&[5, 6]) };
            }
            _ => {}
        }
    }

    fn name_parameter(&mut self, message_id: u32) {
        let name = self.random.pick(&Parameter::ALL).definition().name.as_bytes();
        let at = if message_id == 20 { 4 } else { 6 };
        self.payload[at..at + 16].fill(0);
        self.payload[at..at + name.len()].copy_from_slice(name);
        if message_id == 20 {
            self.payload[..2].copy_from_slice(&(-1_i16).to_le_bytes());
        } else {
            self.payload[22] = self.random.pick(&[6, 9]);
            if self.random.one_in(2) {
                let number = self.random.below(8) as u32;
                self.payload[..4].copy_from_slice(&number.to_le_bytes());
            }
        }
    }

    /// Whether the payload as it will be read reaches the vehicle.
    fn is_for_vehicle(&self, form: &Form) -> bool {
        let [system, component] = [form.system_at, form.component_at].map(|at| at.map_or(0, |at| self.byte(at)));
        [0, VEHICLE[0]].contains(&system) && [0, VEHICLE[1]].contains(&component)
    }

    /// Notes whether it arms, or stops the motors.
    fn judge(&mut self, form: &Form) {
        let command = if [75, 76].contains(&form.message_id) {
            u16::from_le_bytes([self.byte(28), self.byte(29)])
        } else {
            0
        };
        let [first, second] = [0, 4].map(|at| f32::from_le_bytes([0, 1, 2, 3].map(|byte| self.byte(at + byte))));
        self.request.arms = command == 400 && first == 1.0;
        self.request.stops =
            (command == 400 && first == 0.0 && second == FORCED) || (command == 185 && first > 0.5);
    }

    fn byte(&self, at: usize) -> u8 {
        self.payload.get(at).copied().unwrap_or(0)
    }

    fn frame(&mut self, message_id: u32, sealing: Sealing) {
        self.sequence = self.sequence.wrapping_add(1);
        self.time += 1;
        let mut bytes = [0; SIGNATURE_LEN];
        self.random.fill(&mut bytes);
        let (flags, seal) = match (sealing, &self.key) {
            (Sealing::Right, Some(key)) => (SIGNED, Seal::Of(key.clone(), 0, SignatureTime(self.time))),
            (Sealing::Unsigned, _) => (0, Seal::Bytes(bytes)),
            (Sealing::Wrong | Sealing::Right, _) => (SIGNED, Seal::Bytes(bytes)),
        };
        let version = if flags == 0 && message_id < 256 && self.random.one_in(8) {
            FrameVersion::V1
        } else {
            FrameVersion::V2
        };
        let draft = FrameDraft {
            version,
            flags,
            sequence: self.sequence,
            sender: self.sender,
            message_id,
            payload: &self.payload,
        };
        self.request.datagram.clear();
        draft.write(0, &seal, &mut self.request.datagram);
    }

    /// Puts the frame into the payload of one that is damaged.
    fn hide(&mut self) {
        let mut payload = core::mem::take(&mut self.request.datagram);
        payload.truncate(255);
        let draft = FrameDraft {
            version: FrameVersion::V2,
            flags: 0,
            sequence: self.sequence,
            sender: [255, 190],
            message_id: 76,
            payload: &payload,
        };
        let damage = 1 + self.random.below(0xffff) as u16;
        draft.write(damage, &Seal::Bytes([0; SIGNATURE_LEN]), &mut self.request.datagram);
        assert!(Frames::new(&self.request.datagram).flatten().next().is_none());
    }
}
