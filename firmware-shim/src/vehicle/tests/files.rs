//! Files that the vehicle hands out, and how clients find them.

use mavlink::dialects::common::FILE_TRANSFER_PROTOCOL_DATA;

use super::*;
use crate::files::packet::{DATA_LIMIT, PACKET_LEN};
use crate::parameter::protocol::checksum;

const OPEN: u8 = 4;
const READ: u8 = 5;
const BURST: u8 = 15;
const DATA: usize = PACKET_LEN - DATA_LIMIT;

/// The request of a number, about session 0.
fn request(number: u8, operation: u8, offset: u32, data: &[u8]) -> FILE_TRANSFER_PROTOCOL_DATA {
    let mut payload = [0; PACKET_LEN];
    let size = if operation == OPEN { data.len() } else { DATA_LIMIT };
    payload[..5].copy_from_slice(&[number, 0, 0, operation, size as u8]);
    payload[8..DATA].copy_from_slice(&offset.to_le_bytes());
    payload[DATA..DATA + data.len()].copy_from_slice(data);
    FILE_TRANSFER_PROTOCOL_DATA { target_network: 0, target_system: 1, target_component: 1, payload }
}

/// The packets that answer a request.
fn packets(rig: &mut Rig, request: &FILE_TRANSFER_PROTOCOL_DATA) -> Vec<[u8; PACKET_LEN]> {
    let packet = |answer: &MavMessage| match answer {
        MavMessage::FILE_TRANSFER_PROTOCOL(answer) => {
            assert_eq!([answer.target_system, answer.target_component], [255, 190]);
            answer.payload
        }
        answer => panic!("{answer:?}"),
    };
    rig.answers(&datagram(request)).iter().map(packet).collect()
}

/// What a file holds, by bursts.
fn download(rig: &mut Rig, path: &str) -> Vec<u8> {
    let opened = packets(rig, &request(0, OPEN, 0, path.as_bytes()));
    assert_eq!(opened[0][..6], [1, 0, 0, 128, 4, OPEN]);
    let len = u32::from_le_bytes(*opened[0][DATA..].first_chunk().unwrap());
    let mut content = Vec::new();
    for number in 1.. {
        let burst = packets(rig, &request(number, BURST, content.len() as u32, &[]));
        if burst[0][3] == 129 {
            assert_eq!(burst[0][DATA], 6, "end of the file");
            break;
        }
        assert_eq!(burst.last().unwrap()[6], 1, "the burst is complete");
        for packet in burst {
            content.extend(&packet[DATA..DATA + usize::from(packet[4])]);
        }
    }
    assert_eq!(content.len(), len as usize);
    // TerminateSession.
    assert_eq!(packets(rig, &request(99, 1, 0, &[]))[0][3], 128);
    content
}

fn path_of(uri: &str) -> &str {
    uri.strip_prefix("mftp://").unwrap()
}

#[test]
fn a_request_for_metadata_leads_to_a_file_that_can_be_read_and_from_there_to_all_parameters() {
    let mut rig = Rig::new();
    let question = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [397.0; 7]);
    let answers = rig.answers(&datagram(&question));
    let [MavMessage::COMPONENT_METADATA(told), MavMessage::COMMAND_ACK(_)] = &answers[..] else {
        panic!("{answers:?}")
    };
    let general = download(&mut rig, path_of(told.uri.to_str().unwrap()));
    assert_eq!(checksum(0, &general), told.file_crc);
    let general: serde_json::Value = serde_json::from_slice(&general).unwrap();
    let metadata = &general["metadataTypes"][0];
    assert_eq!(metadata["type"], 1);
    let parameters = download(&mut rig, path_of(metadata["uri"].as_str().unwrap()));
    assert_eq!(metadata["fileCrc"], checksum(0, &parameters));
    let parameters: serde_json::Value = serde_json::from_slice(&parameters).unwrap();
    let described = parameters["parameters"].as_array().unwrap();
    assert_eq!(described.len(), Parameter::ALL.len());
}

#[test]
fn the_deprecated_question_has_the_same_answer() {
    let mut rig = Rig::new();
    let told = rig.answers(&datagram(&command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [397.0; 7])));
    let old = rig.answers(&datagram(&command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [395.0; 7])));
    let (MavMessage::COMPONENT_METADATA(told), MavMessage::COMPONENT_INFORMATION(old)) = (&told[0], &old[0])
    else {
        panic!("{told:?} {old:?}")
    };
    assert_eq!(old.general_metadata_uri.to_str(), told.uri.to_str());
    assert_eq!(old.general_metadata_file_crc, told.file_crc);
    assert_eq!(old.peripherals_metadata_uri.to_str(), Ok(""));
}

#[test]
fn it_says_that_it_has_files() {
    use mavlink::dialects::common::MavProtocolCapability;
    let mut rig = Rig::new();
    let answers = rig.answers(&datagram(&command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0; 7])));
    let MavMessage::AUTOPILOT_VERSION(version) = &answers[0] else { panic!("{answers:?}") };
    assert!(version.capabilities.contains(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP));
}

#[test]
fn a_whole_burst_is_answered_at_once() {
    let mut rig = Rig::new();
    packets(&mut rig, &request(0, OPEN, 0, b"/parameters.json"));
    let before = rig.vehicle.counts().unanswered;
    let burst = packets(&mut rig, &request(1, BURST, 0, &[]));
    assert!(burst.len() > 10 && burst.len() < ANSWERS, "{}", burst.len());
    assert_eq!(rig.vehicle.counts().unanswered, before);
}

#[test]
fn what_is_meant_for_another_system_and_what_is_an_answer_go_unanswered() {
    let mut rig = Rig::new();
    let foreign = FILE_TRANSFER_PROTOCOL_DATA { target_system: 2, ..request(0, READ, 0, &[]) };
    assert!(packets(&mut rig, &foreign).is_empty());
    for operation in [128, 129] {
        assert!(packets(&mut rig, &request(0, operation, 0, &[])).is_empty());
    }
    // The path of a parameter file that ArduPilot has: clients ask for the list then.
    let absent = packets(&mut rig, &request(5, OPEN, 0, b"@PARAM/param.pck"));
    assert_eq!((absent[0][0], absent[0][3], absent[0][5], absent[0][DATA]), (6, 129, OPEN, 10));
}
