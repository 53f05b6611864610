//! What a ROS 2 system agrees on outside of any message: its domain, and how services are mapped.

use ros2_client::ServiceMapping;

/// Greatest domain whose ports are ports.
const DOMAIN_LIMIT: u16 = 232;

/// How a node meets the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NodeSettings {
    /// Who does not have the same hears nothing, 0 to 232.
    pub domain: u16,
    /// Whose services are spoken.
    pub mapping: Middleware,
}

/// Whose way a request finds its answer; topics are the same for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Middleware {
    /// eProsima's, the default of ROS 2, and RTI's.
    #[default]
    FastDds,
    /// Eclipse's.
    CycloneDds,
}

/// A setting that cannot be followed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{variable}: found `{found}`, expected {expected}")]
pub struct SettingsError {
    variable: &'static str,
    found: String,
    expected: &'static str,
}

impl NodeSettings {
    /// By the variables that ROS 2 itself reads: `ROS_DOMAIN_ID` and `RMW_IMPLEMENTATION`.
    ///
    /// # Errors
    /// When one is set to what cannot be followed.
    pub fn of_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Self, SettingsError> {
        let given = |name| variable(name).filter(|value| !value.is_empty());
        let domain = given("ROS_DOMAIN_ID").map(|text| domain(&text)).transpose()?.unwrap_or_default();
        let mapping =
            given("RMW_IMPLEMENTATION").map(|name| Middleware::of(&name)).transpose()?.unwrap_or_default();
        Ok(Self { domain, mapping })
    }
}

fn domain(text: &str) -> Result<u16, SettingsError> {
    let number = text.parse().ok().filter(|domain| *domain <= DOMAIN_LIMIT);
    number.ok_or_else(|| SettingsError { variable: "ROS_DOMAIN_ID", found: text.to_owned(), expected: "0 to 232" })
}

impl Middleware {
    fn of(name: &str) -> Result<Self, SettingsError> {
        match name {
            "rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp" | "rmw_connextdds" => Ok(Self::FastDds),
            "rmw_cyclonedds_cpp" => Ok(Self::CycloneDds),
            other => Err(SettingsError {
                variable: "RMW_IMPLEMENTATION",
                found: other.to_owned(),
                expected: "one that speaks DDS: rmw_fastrtps_cpp, rmw_cyclonedds_cpp, rmw_connextdds",
            }),
        }
    }

    pub(super) const fn of_services(self) -> ServiceMapping {
        match self {
            Self::FastDds => ServiceMapping::Enhanced,
            Self::CycloneDds => ServiceMapping::Cyclone,
        }
    }
}
