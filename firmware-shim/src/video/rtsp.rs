//! Requests and replies of RTSP 1.0 (RFC 2326), and the description of the stream in SDP (RFC 8866).

use std::net::IpAddr;

use super::VideoFormat;
use super::rtp::{CLOCK_HZ, PAYLOAD_TYPE};

/// Path of the stream.
pub(super) const PATH: &str = "/camera";

/// What a client sets up below the path.
pub(super) const TRACK: &str = "track1";

/// Bytes of a request without its body: many times what players send.
pub(super) const HEAD_LIMIT: usize = 8 << 10;

/// Methods that the server answers (RFC 2326, section 12.28).
pub(super) const METHODS: &str = "OPTIONS, DESCRIBE, SETUP, PLAY, PAUSE, TEARDOWN, GET_PARAMETER, SET_PARAMETER";

/// First byte of a packet between requests, and bytes before its payload (RFC 2326, section 10.12).
const INTERLEAVED_MAGIC: u8 = b'$';
const INTERLEAVED_HEADER_LEN: usize = 4;

/// What base64 makes of six bits (RFC 4648, table 1).
const BASE64: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// What a client wants (RFC 2326, section 10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RtspMethod {
    /// What the server can do.
    Options,
    /// What the stream is.
    Describe,
    /// How packets are to be sent.
    Setup,
    /// Packets.
    Play,
    /// No packets for a while.
    Pause,
    /// The end of the session.
    Teardown,
    /// A sign of life.
    GetParameter,
    /// As `GetParameter`.
    SetParameter,
    /// A method of the standard that this server does not offer.
    NotOffered,
    /// A method that the standard does not know.
    Unknown,
}

impl RtspMethod {
    fn parse(name: &str) -> Self {
        match name {
            "OPTIONS" => Self::Options,
            "DESCRIBE" => Self::Describe,
            "SETUP" => Self::Setup,
            "PLAY" => Self::Play,
            "PAUSE" => Self::Pause,
            "TEARDOWN" => Self::Teardown,
            "GET_PARAMETER" => Self::GetParameter,
            "SET_PARAMETER" => Self::SetParameter,
            "ANNOUNCE" | "RECORD" | "REDIRECT" => Self::NotOffered,
            _ => Self::Unknown,
        }
    }

    /// Whether it is about the stream, and not about the server or the connection.
    pub(super) fn names_stream(self) -> bool {
        match self {
            Self::Describe | Self::Setup | Self::Play | Self::Pause | Self::Teardown => true,
            Self::Options | Self::GetParameter | Self::SetParameter | Self::NotOffered | Self::Unknown => false,
        }
    }
}

/// How a request ended (RFC 2326, section 7.1.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RtspStatus {
    /// 200.
    Ok,
    /// 400.
    BadRequest,
    /// 404.
    NotFound,
    /// 405.
    MethodNotAllowed,
    /// 413.
    TooLarge,
    /// 454.
    SessionNotFound,
    /// 455.
    NotValidInState,
    /// 461.
    UnsupportedTransport,
    /// 500.
    InternalError,
    /// 501.
    NotImplemented,
    /// 503.
    Unavailable,
    /// 505.
    UnsupportedVersion,
}

impl RtspStatus {
    fn line(self) -> &'static str {
        match self {
            Self::Ok => "200 OK",
            Self::BadRequest => "400 Bad Request",
            Self::NotFound => "404 Not Found",
            Self::MethodNotAllowed => "405 Method Not Allowed",
            Self::TooLarge => "413 Request Entity Too Large",
            Self::SessionNotFound => "454 Session Not Found",
            Self::NotValidInState => "455 Method Not Valid in This State",
            Self::UnsupportedTransport => "461 Unsupported Transport",
            Self::InternalError => "500 Internal Server Error",
            Self::NotImplemented => "501 Not Implemented",
            Self::Unavailable => "503 Service Unavailable",
            Self::UnsupportedVersion => "505 RTSP Version Not Supported",
        }
    }
}

/// A request, without its body.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct RtspRequest {
    /// What is wanted.
    pub(super) method: RtspMethod,
    /// Of what.
    pub(super) uri: String,
    /// `CSeq`.
    pub(super) sequence: u32,
    /// Names and values.
    headers: Vec<(String, String)>,
}

impl RtspRequest {
    fn parse(head: &[u8]) -> Result<Self, RtspReply> {
        let text = str::from_utf8(head).map_err(|_| RtspReply::new(RtspStatus::BadRequest, None))?;
        let mut lines = text.lines();
        let first: Vec<&str> = lines.next().unwrap_or_default().split_ascii_whitespace().collect();
        let fields = lines.take_while(|line| !line.is_empty()).map(|line| line.split_once(':'));
        let headers: Option<Vec<(String, String)>> = fields
            .map(|field| field.map(|(name, value)| (name.trim().to_owned(), value.trim().to_owned())))
            .collect();
        let headers = headers.ok_or_else(|| RtspReply::new(RtspStatus::BadRequest, None))?;
        let sequence = header(&headers, "CSeq").and_then(|value| value.parse().ok());

        let refused = |status| Err(RtspReply::new(status, sequence));
        match (first.as_slice(), sequence) {
            ([method, uri, "RTSP/1.0"], Some(sequence)) => {
                Ok(Self { method: RtspMethod::parse(method), uri: (*uri).to_owned(), sequence, headers })
            }
            ([_, _, version], Some(_)) if version.starts_with("RTSP/") => refused(RtspStatus::UnsupportedVersion),
            _ => refused(RtspStatus::BadRequest),
        }
    }

    /// Value of a header, in the case of whose name clients differ.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        header(&self.headers, name)
    }

    /// Session that the request belongs to, without its parameters.
    pub(super) fn session(&self) -> Option<&str> {
        self.header("Session")?.split(';').next().map(str::trim)
    }

    /// Bytes that follow the head.
    fn body_len(&self) -> Result<usize, RtspReply> {
        let unreadable = |_| RtspReply::new(RtspStatus::BadRequest, Some(self.sequence));
        self.header("Content-Length").map_or(Ok(0), |value| value.parse().map_err(unreadable))
    }

    /// Address of the whole stream, if the request is about it or its track.
    pub(super) fn stream_uri(&self) -> Option<&str> {
        let (base, _) = self.uri.split_once('?').unwrap_or((&self.uri, ""));
        let base = base.trim_end_matches('/');
        let base = base.strip_suffix(TRACK).map_or(base, |base| base.trim_end_matches('/'));
        let (scheme, rest) = base.split_once("://")?;
        let path = rest.find('/').and_then(|start| rest.get(start..))?;
        (scheme.eq_ignore_ascii_case("rtsp") && path == PATH).then_some(base)
    }

    /// The beginning of a reply that grants the request.
    pub(super) fn granted(&self) -> RtspReply {
        RtspReply::new(RtspStatus::Ok, Some(self.sequence))
    }
}

fn header<'h>(headers: &'h [(String, String)], name: &str) -> Option<&'h str> {
    headers.iter().find(|(found, _)| found.eq_ignore_ascii_case(name)).map(|(_, value)| value.as_str())
}

/// What a client is told.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct RtspReply {
    status: RtspStatus,
    /// `CSeq` of the request, if it could be read.
    sequence: Option<u32>,
    headers: Vec<(&'static str, String)>,
    body: String,
}

impl RtspReply {
    /// A reply without headers and body.
    pub(super) fn new(status: RtspStatus, sequence: Option<u32>) -> Self {
        Self { status, sequence, headers: Vec::new(), body: String::new() }
    }

    /// Adds a header.
    pub(super) fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.headers.push((name, value.into()));
        self
    }

    /// Adds a description of the stream.
    pub(super) fn with_description(mut self, description: String) -> Self {
        self.body = description;
        self.with("Content-Type", "application/sdp")
    }

    /// As it is sent.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let sequence = self.sequence.map(|sequence| format!("CSeq: {sequence}\r\n")).unwrap_or_default();
        let headers: Vec<_> = self.headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let length = match self.body.len() {
            0 => String::new(),
            length => format!("Content-Length: {length}\r\n"),
        };
        let first = format!("RTSP/1.0 {}\r\n", self.status.line());
        [first, sequence, headers.concat(), length, "\r\n".into(), self.body.clone()].concat().into_bytes()
    }
}

/// What a client sent.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Incoming {
    /// A request.
    Request(RtspRequest),
    /// A packet between requests: a receiver report, which is skipped.
    Packet,
}

/// Cuts what comes from a client into requests, and skips bodies and packets.
#[derive(Debug, Default)]
pub(super) struct RtspParser {
    unread: Vec<u8>,
    /// Bytes to come that carry nothing.
    skipped_len: usize,
}

impl RtspParser {
    /// Adds bytes as they came.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.unread.extend(bytes);
    }

    /// The next thing, if it is whole. After an error, which is to be sent, there is no telling where a request begins.
    pub(super) fn take(&mut self) -> Result<Option<Incoming>, RtspReply> {
        self.skip();
        self.skipped_len += self.unread.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        self.skip();
        if self.unread.first() == Some(&INTERLEAVED_MAGIC) {
            let Some(&[_, _, high, low]) = self.unread.first_chunk::<INTERLEAVED_HEADER_LEN>() else {
                return Ok(None);
            };
            self.skipped_len = INTERLEAVED_HEADER_LEN + usize::from(u16::from_be_bytes([high, low]));
            return Ok(Some(Incoming::Packet));
        }
        let head_len = head_len(&self.unread);
        if head_len.unwrap_or(self.unread.len()) > HEAD_LIMIT {
            return Err(RtspReply::new(RtspStatus::TooLarge, None));
        }
        let Some(head_len) = head_len else { return Ok(None) };
        let head: Vec<u8> = self.unread.drain(..head_len).collect();
        let request = RtspRequest::parse(&head)?;
        self.skipped_len = request.body_len()?;
        Ok(Some(Incoming::Request(request)))
    }

    fn skip(&mut self) {
        let len = self.skipped_len.min(self.unread.len());
        self.unread.drain(..len);
        self.skipped_len -= len;
    }
}

/// Bytes up to the first empty line, which ends a head.
fn head_len(bytes: &[u8]) -> Option<usize> {
    let mut line_start = 0;
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        line_start += line.len();
        if matches!(line, b"\n" | b"\r\n") {
            return Some(line_start);
        }
    }
    None
}

/// How packets travel (RFC 2326, section 12.39).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RtspTransport {
    /// Between requests and replies, on two channels.
    Interleaved {
        /// Of pictures.
        rtp_channel: u8,
        /// Of reports.
        rtcp_channel: u8,
    },
    /// To two UDP ports of the client.
    Udp {
        /// For pictures.
        rtp_port: u16,
        /// For reports.
        rtcp_port: u16,
    },
}

impl RtspTransport {
    /// The first of a client's offers that this server supports.
    pub(super) fn parse(offers: &str) -> Option<Self> {
        offers.split(',').find_map(Self::parse_offer)
    }

    fn parse_offer(offer: &str) -> Option<Self> {
        let mut fields = offer.split(';').map(str::trim);
        let profile = fields.next()?.to_ascii_uppercase();
        let parameters: Vec<&str> = fields.collect();
        if parameters.iter().any(|parameter| parameter.eq_ignore_ascii_case("multicast")) {
            return None;
        }
        let pair = |name: &str| {
            let named = parameters.iter().filter_map(|parameter| parameter.split_once('='));
            named.into_iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| number_pair(value))
        };
        match profile.as_str() {
            "RTP/AVP/TCP" => {
                let [rtp, rtcp] = pair("interleaved").unwrap_or(Some([0, 1]))?;
                let (rtp_channel, rtcp_channel) = (rtp.try_into().ok()?, rtcp.try_into().ok()?);
                Some(Self::Interleaved { rtp_channel, rtcp_channel })
            }
            "RTP/AVP" | "RTP/AVP/UDP" => {
                let [rtp_port, rtcp_port] = pair("client_port")??;
                (rtp_port != 0 && rtcp_port != 0).then_some(Self::Udp { rtp_port, rtcp_port })
            }
            _ => None,
        }
    }
}

/// `6970-6971`, or `6970` alone, which its successor follows.
fn number_pair(text: &str) -> Option<[u16; 2]> {
    match text.split_once('-') {
        Some((first, second)) => Some([first.trim().parse().ok()?, second.trim().parse().ok()?]),
        None => text.trim().parse::<u16>().ok().and_then(|first| Some([first, first.checked_add(1)?])),
    }
}

/// Head of a packet between requests, on a channel.
pub(super) fn interleaved_header(channel: u8, len: u16) -> [u8; INTERLEAVED_HEADER_LEN] {
    let [high, low] = len.to_be_bytes();
    [INTERLEAVED_MAGIC, channel, high, low]
}

/// Describes the stream (RFC 8866; RFC 6184, section 8.2.1) of the server at an address.
pub(super) fn describe(format: &VideoFormat, server: IpAddr) -> String {
    let (family, any) = if server.is_ipv4() { ("IP4", "0.0.0.0") } else { ("IP6", "::") };
    let [profile, constraints, level] = format.profile_and_level().unwrap_or_default();
    let parameter_sets = [&format.sequence_parameter_set, &format.picture_parameter_set].map(|set| base64(set));
    let VideoFormat { columns, rows, rate_hz, .. } = format;
    let lines = [
        "v=0".to_owned(),
        format!("o=- 0 0 IN {family} {server}"),
        "s=Kestrel camera".to_owned(),
        format!("c=IN {family} {any}"),
        "t=0 0".to_owned(),
        "a=control:*".to_owned(),
        "a=range:npt=now-".to_owned(),
        format!("m=video 0 RTP/AVP {PAYLOAD_TYPE}"),
        format!("a=rtpmap:{PAYLOAD_TYPE} H264/{CLOCK_HZ}"),
        format!(
            "a=fmtp:{PAYLOAD_TYPE} packetization-mode=1;profile-level-id={profile:02X}{constraints:02X}{level:02X};\
             sprop-parameter-sets={}",
            parameter_sets.join(",")
        ),
        format!("a=framerate:{rate_hz}"),
        format!("a=framesize:{PAYLOAD_TYPE} {columns}-{rows}"),
        format!("a=control:{TRACK}"),
    ];
    lines.map(|line| line + "\r\n").concat()
}

/// Base64 with padding (RFC 4648, section 4).
pub(super) fn base64(bytes: &[u8]) -> String {
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for number in 0..4 {
            let six_bits = (bits >> (18 - 6 * number)) as usize % BASE64.len();
            text.push(if number <= group.len() { char::from(BASE64[six_bits]) } else { '=' });
        }
    }
    text
}
