#![expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]

use mavlink::dialects::common::{MavMessage, MavParamType, PARAM_ERROR_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA};
use proptest::prelude::*;

use super::super::received;
use super::*;
use crate::frame::{Encoder, Frames};
use crate::testing::{datagram, message};

/// The vehicle's side, and a client that writes and reads with the mavlink crate.
struct Rig {
    protocol: ParameterProtocol,
    heard: Vec<MavMessage>,
}

impl Rig {
    fn new() -> Self {
        Self { protocol: ParameterProtocol::new(Parameters::new(1)), heard: Vec::new() }
    }

    fn receive(&mut self, datagram: &[u8]) -> Option<Parameter> {
        let frame = Frames::new(datagram).next().unwrap().unwrap();
        let (_, request) = received::request(&frame).unwrap();
        let heard = &mut self.heard;
        self.protocol.handle(&request, [frame.system, frame.component], &mut |payload| {
            heard.push(message(&Encoder::new(1, 1).encode(&payload)));
        })
    }

    fn tick(&mut self) -> usize {
        let before = self.heard.len();
        let heard = &mut self.heard;
        self.protocol.tick(&mut |payload| heard.push(message(&Encoder::new(1, 1).encode(&payload))));
        self.heard.len() - before
    }

    fn set(&mut self, name: &str, value: ParameterValue) -> Option<Parameter> {
        let kind = match value.kind() {
            ParameterType::Int32 => MavParamType::MAV_PARAM_TYPE_INT32,
            ParameterType::Real32 => MavParamType::MAV_PARAM_TYPE_REAL32,
        };
        self.set_as(name, value.to_bytes(), kind)
    }

    fn set_as(&mut self, name: &str, bytes: [u8; 4], param_type: MavParamType) -> Option<Parameter> {
        self.heard.clear();
        self.receive(&datagram(&PARAM_SET_DATA {
            param_value: f32::from_le_bytes(bytes),
            target_system: 1,
            target_component: 1,
            param_id: name.into(),
            param_type,
        }))
    }

    fn ask(&mut self, index: i16, name: &str) -> MavMessage {
        self.heard.clear();
        self.receive(&datagram(&mavlink::dialects::common::PARAM_REQUEST_READ_DATA {
            param_index: index,
            target_system: 1,
            target_component: 1,
            param_id: name.into(),
        }));
        assert_eq!(self.heard.len(), 1);
        self.heard.remove(0)
    }

    fn ask_for_list(&mut self) {
        let request = mavlink::dialects::common::PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 };
        self.receive(&datagram(&request));
    }

    fn told(&self) -> Vec<(u16, String)> {
        let told = |message: &MavMessage| match message {
            MavMessage::PARAM_VALUE(value) => {
                assert_eq!(value.param_count as usize, PARAMETERS);
                Some((value.param_index, value.param_id.to_str().unwrap().to_owned()))
            }
            _ => None,
        };
        self.heard.iter().filter_map(told).collect()
    }
}

#[test]
fn a_list_is_told_in_order_a_few_in_a_tick() {
    let mut rig = Rig::new();
    assert_eq!(rig.tick(), 0);
    rig.ask_for_list();
    let mut ticks = 0;
    while rig.tick() > 0 {
        ticks += 1;
    }
    assert_eq!(ticks, PARAMETERS.div_ceil(VALUES_PER_TICK));
    let expected: Vec<_> =
        Parameter::ALL.iter().map(|parameter| (*parameter as u16, parameter.to_string())).collect();
    assert_eq!(rig.told(), expected);
}

#[test]
fn a_flood_of_list_requests_keeps_nothing_from_anybody() {
    let mut rig = Rig::new();
    for _ in 0..PARAMETERS {
        rig.ask_for_list();
        assert_eq!(rig.tick(), VALUES_PER_TICK);
    }
    for parameter in Parameter::ALL {
        assert!(rig.told().iter().any(|(index, _)| *index == parameter as u16), "{parameter}");
    }
}

#[test]
fn one_is_told_by_index_and_by_name() {
    let mut rig = Rig::new();
    for parameter in Parameter::ALL {
        let by_index = rig.ask(parameter as i16, "");
        assert_eq!(by_index, rig.ask(-1, parameter.definition().name));
        let MavMessage::PARAM_VALUE(PARAM_VALUE_DATA { param_index, .. }) = by_index else { panic!() };
        assert_eq!(param_index, parameter as u16);
    }
}

#[test]
fn what_does_not_exist_is_said_so() {
    let mut rig = Rig::new();
    let error = |message| match message {
        MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
            error, target_system, target_component, param_index, ..
        }) => {
            assert_eq!((target_system, target_component), (255, 190));
            (error, param_index)
        }
        message => panic!("{message:?}"),
    };
    let missing = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
    assert_eq!(error(rig.ask(PARAMETERS as i16, "")), (missing, PARAMETERS as i16));
    assert_eq!(error(rig.ask(-2, "")), (missing, -2));
    assert_eq!(error(rig.ask(-1, "GF_NOTHING")), (missing, -1));
    assert_eq!(rig.set("GF_NOTHING", ParameterValue::Integer(1)), None);
    assert_eq!(error(rig.heard.remove(0)), (missing, -1));
    assert!(rig.heard.is_empty());
}

#[test]
fn a_value_is_set_and_told_to_everybody() {
    let mut rig = Rig::new();
    assert_eq!(rig.set("MPC_XY_CRUISE", ParameterValue::Real(1.25)), Some(Parameter::MpcXyCruise));
    let [MavMessage::PARAM_VALUE(value)] = &rig.heard[..] else { panic!("{:?}", rig.heard) };
    assert_eq!((value.param_value, value.param_type), (1.25, MavParamType::MAV_PARAM_TYPE_REAL32));
    assert_eq!(rig.protocol.settings().cruise_speed, 1.25);
    assert_eq!(rig.set("GF_ACTION", ParameterValue::Integer(5)), Some(Parameter::GfAction));
    let [MavMessage::PARAM_VALUE(value)] = &rig.heard[..] else { panic!("{:?}", rig.heard) };
    assert_eq!(value.param_value.to_bits(), 5, "an integer travels bytewise");
    assert_eq!(rig.set("GF_ACTION", ParameterValue::Integer(5)), None, "nothing new");
    assert_eq!(rig.heard.len(), 1, "told again, as the first answer may be lost");
}

#[test]
fn a_refusal_says_why_and_tells_the_old_value() {
    let mut rig = Rig::new();
    let refusals = [
        ("MPC_XY_CRUISE", ParameterValue::Real(50.0), MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        ("MPC_XY_CRUISE", ParameterValue::Real(f32::NAN), MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        ("MPC_XY_CRUISE", ParameterValue::Integer(1), MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH),
        ("GF_ACTION", ParameterValue::Real(1.0), MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH),
        ("GF_ACTION", ParameterValue::Integer(4), MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        ("SYS_ID", ParameterValue::Integer(2), MavParamError::MAV_PARAM_ERROR_READ_ONLY),
    ];
    let before = rig.protocol.parameters().clone();
    for (name, value, expected) in refusals {
        assert_eq!(rig.set(name, value), None);
        let [MavMessage::PARAM_ERROR(error), MavMessage::PARAM_VALUE(told)] = &rig.heard[..] else {
            panic!("{:?}", rig.heard)
        };
        assert_eq!((error.error, error.param_id.to_str()), (expected, Ok(name)));
        let parameter = Parameter::named(name).unwrap();
        assert_eq!(told.param_value.to_le_bytes(), before.get(parameter).to_bytes());
    }
    assert_eq!(rig.set_as("GF_ACTION", [1, 0, 0, 0], MavParamType::MAV_PARAM_TYPE_UINT8), None);
    let [MavMessage::PARAM_ERROR(error), MavMessage::PARAM_VALUE(_)] = &rig.heard[..] else { panic!() };
    assert_eq!(error.error, MavParamError::MAV_PARAM_ERROR_TYPE_UNSUPPORTED);
    assert_eq!(rig.protocol.parameters(), &before);
}

#[test]
fn the_hash_is_the_checksum_of_px4_and_follows_every_value() {
    assert_eq!(checksum(0, b"123456789"), 0x2dfd_2d88, "CRC-32 without inversions, by zlib");
    let mut rig = Rig::new();
    let MavMessage::PARAM_VALUE(before) = rig.ask(-1, HASH_NAME) else { panic!() };
    assert_eq!(before.param_type, MavParamType::MAV_PARAM_TYPE_UINT32);
    assert_eq!(before.param_index, u16::MAX);
    rig.set("FD_FAIL_TILT", ParameterValue::Real(61.0));
    let MavMessage::PARAM_VALUE(after) = rig.ask(-1, HASH_NAME) else { panic!() };
    assert_ne!(after.param_value.to_bits(), before.param_value.to_bits());
    rig.ask_for_list();
    rig.set_as(HASH_NAME, after.param_value.to_le_bytes(), MavParamType::MAV_PARAM_TYPE_UINT32);
    assert_eq!(rig.tick(), 0, "whoever knows the hash knows the list");
}

fn any_request() -> impl Strategy<Value = ParameterRequest> {
    let known = (0..PARAMETERS).prop_map(|index| Parameter::ALL[index].definition().name.into());
    let name = prop_oneof![4 => known, 1 => any::<[u8; 16]>().prop_map(ParameterName)].boxed();
    let kind = prop_oneof![4 => Just(6_u8), 4 => Just(9), 1 => any::<u8>()];
    let special = prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1.0), 0.0_f32..100.0];
    let bytes =
        prop_oneof![special.prop_map(f32::to_le_bytes), (-5_i32..10).prop_map(i32::to_le_bytes), any::<[u8; 4]>()];
    prop_oneof![
        Just(ParameterRequest::List),
        any::<u16>().prop_map(|index| ParameterRequest::Read(ParameterKey::Index(index))),
        name.clone().prop_map(|name| ParameterRequest::Read(ParameterKey::Name(name))),
        (name, kind, bytes).prop_map(|(name, kind, bytes)| ParameterRequest::Set { name, kind, bytes }),
    ]
}

proptest! {
    #[test]
    fn no_request_panics_answers_at_length_or_leaves_a_value_out_of_its_domain(
        requests in proptest::collection::vec(any_request(), 1..100)
    ) {
        let mut protocol = ParameterProtocol::new(Parameters::new(1));
        for request in requests {
            let mut answers = 0;
            protocol.handle(&request, [255, 190], &mut |_| answers += 1);
            prop_assert!(answers <= 2);
            let mut listed = 0;
            protocol.tick(&mut |_| listed += 1);
            prop_assert!(listed <= VALUES_PER_TICK);
        }
        let mut again = Parameters::new(1);
        for parameter in Parameter::ALL.into_iter().filter(|parameter| *parameter != Parameter::SysId) {
            prop_assert_eq!(again.set(parameter, protocol.parameters().get(parameter)), Ok(()));
        }
        prop_assert_eq!(protocol.settings(), again.settings());
    }
}
