//! The vehicle as a ROS 2 node, if the program was built with one.

use kestrel_shim::policy_backend::PolicyBackend;
use kestrel_shim::session::{Session, SessionOptions};

/// Lets the vehicle be a node, too.
///
/// # Errors
/// Why there is none, in words.
#[cfg(feature = "ros2")]
pub(super) fn attach<P: PolicyBackend>(
    session: &mut Session<P>,
    name: &str,
    options: &SessionOptions,
) -> Result<(), String> {
    use kestrel_ros::node::{NodeSettings, RosLink};

    let settings =
        NodeSettings::of_variables(|name| std::env::var(name).ok()).map_err(|error| error.to_string())?;
    let link = RosLink::open(name, options.system, options.home, &settings).map_err(|error| error.to_string())?;
    let words = format!(
        "ROS 2 node /{name} in domain {}: ros2 service list, ros2 topic echo /{name}/odom\n\
         Reachable from other machines: whoever is in the domain can fly it.",
        settings.domain
    );
    session.attach(Box::new(link), &words).map_err(|error| error.to_string())
}

/// See above.
///
/// # Errors
/// Always.
#[cfg(not(feature = "ros2"))]
pub(super) fn attach<P: PolicyBackend>(
    _session: &mut Session<P>,
    _name: &str,
    _options: &SessionOptions,
) -> Result<(), String> {
    Err("this program was built without ROS 2: build it with `--features ros2`".to_owned())
}
