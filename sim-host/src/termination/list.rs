//! What the list of terminations becomes.

/// From lines `"key" Type in module;` to the enum of all terminations, which YAML writes as `key: { … }`, or as `key` those
/// that stand alone.
macro_rules! terminations {
    (
        alone { $($lone_key:tt $lone:ident in $lone_module:ident;)* }
        with { $($key:tt $rule:ident in $module:ident;)* }
    ) => {
        $(use $lone_module::$lone;)*
        $(pub use $module::$rule;)*

        /// What ends an episode before its time; a failure unless it says success.
        #[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[allow(missing_docs, reason = "the types of the variants say it")]
        pub enum Termination {
            $(
                #[serde(rename = $lone_key)]
                $lone,
            )*
            $(
                #[serde(rename = $key)]
                $rule($rule),
            )*
            /// One of a user's own crate.
            #[serde(skip)]
            Custom(Custom),
        }

        impl Termination {
            /// The keys in YAML, in the order of the list.
            pub const KEYS: &[&str] = &[$($lone_key,)* $($key),*];

            /// Key in YAML.
            pub fn name(&self) -> &str {
                match self {
                    $(Self::$lone => $lone_key,)*
                    $(Self::$rule(_) => $key,)*
                    Self::Custom(rule) => rule.function.name(),
                }
            }

            /// How its ends are reported.
            pub fn ending(&self) -> Ending {
                match self {
                    $(Self::$lone => $lone.ending(),)*
                    $(Self::$rule(rule) => rule.ending(),)*
                    Self::Custom(rule) => rule.function.ending(),
                }
            }

            /// Whether its ends are cut-offs from which the future is still estimated, rather than terminal states.
            pub fn truncates(&self) -> bool {
                match self {
                    $(Self::$lone => $lone.truncates(),)*
                    $(Self::$rule(rule) => rule.truncates(),)*
                    Self::Custom(rule) => rule.truncates,
                }
            }

            pub(crate) fn start_limit(&self) -> StartLimit {
                match self {
                    $(Self::$lone => $lone.start_limit(),)*
                    $(Self::$rule(rule) => rule.start_limit(),)*
                    Self::Custom(_) => StartLimit::None,
                }
            }

            pub(crate) fn contacts(&self) -> Option<Contacts> {
                match self {
                    $(Self::$lone => $lone.contacts(),)*
                    $(Self::$rule(rule) => rule.contacts(),)*
                    Self::Custom(_) => None,
                }
            }

            pub(crate) fn memory(&self) -> Memory {
                match self {
                    $(Self::$lone => $lone.memory(),)*
                    $(Self::$rule(rule) => rule.memory(),)*
                    Self::Custom(rule) => rule.function.memory(),
                }
            }

            fn check(&self, task: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
                match self {
                    $(Self::$lone => $lone.check(task, field),)*
                    $(Self::$rule(rule) => rule.check(task, field),)*
                    Self::Custom(_) => Ok(()),
                }
            }

            /// Writes `code` where it ends the episode.
            #[inline(always)]
            pub(crate) fn mark<const LANES: usize, R: Real>(
                &self,
                view: &FlightView<'_, LANES, R>,
                memory: &mut [Column<LANES, R>],
                code: f32,
                codes: &mut Column<LANES>,
            ) {
                match self {
                    $(Self::$lone => $lone.mark(view, memory, code, codes),)*
                    $(Self::$rule(rule) => rule.mark(view, memory, code, codes),)*
                    Self::Custom(rule) => rule.mark(view, memory, code, codes),
                }
            }
        }

        $(impl From<$rule> for Termination {
            fn from(rule: $rule) -> Self {
                Self::$rule(rule)
            }
        })*

        impl From<Custom> for Termination {
            fn from(rule: Custom) -> Self {
                Self::Custom(rule)
            }
        }
    };
}
