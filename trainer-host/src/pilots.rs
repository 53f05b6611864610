//! The pilots that come with the program: those of `assets/pilots`, by name.

/// Names and policy files, in fixed point.
const PILOTS: [(&str, &[u8]); 3] = [
    ("cross", include_bytes!("../../assets/pilots/cross.kestrel")),
    ("hover", include_bytes!("../../assets/pilots/hover.kestrel")),
    ("hover-cf2x", include_bytes!("../../assets/pilots/hover-cf2x.kestrel")),
];

/// The policy file of a pilot.
pub(crate) fn pilot(name: &str) -> Option<&'static [u8]> {
    PILOTS.iter().find(|(shipped, _)| *shipped == name).map(|(_, file)| *file)
}

/// All names, for messages.
pub(crate) fn names() -> String {
    PILOTS.map(|(name, _)| name).join(", ")
}
