//! What the list of reward terms becomes.

/// From lines `"key" Type in module;` to the enum of all terms, which YAML writes as `key: { … }`.
macro_rules! reward_terms {
    ($($key:tt $term:ident in $($module:ident)::+;)*) => {
        $(pub use $($module)::+::$term;)*

        /// One reward term; a penalty has a negative weight.
        ///
        /// The first terms are paid per second (`progress`, `shaping`, `success` and `failure` are not): changing the
        /// control rate does not change what an episode is worth. From `bounds` on the terms are the reference's
        /// components, named after its classes, and paid every control period as there; those that penalise are
        /// negative themselves.
        #[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[allow(missing_docs, reason = "the types of the variants say it")]
        pub enum RewardTerm {
            $(
                #[serde(rename = $key)]
                $term($term),
            )*
            /// One of a user's own crate.
            #[serde(skip)]
            Custom(Custom),
        }

        impl RewardTerm {
            /// The keys in YAML, in the order of the list.
            pub const KEYS: &[&str] = &[$($key),*];

            /// Name in logs, and the key in YAML.
            pub fn name(&self) -> &str {
                match self {
                    $(Self::$term(_) => $key,)*
                    Self::Custom(term) => term.function.name(),
                }
            }

            /// What one unit is worth; penalties are negative.
            pub fn weight(&self) -> f64 {
                match self {
                    $(Self::$term(term) => term.weight,)*
                    Self::Custom(term) => term.weight,
                }
            }

            /// What its unit is paid by.
            pub fn paid(&self) -> Paid {
                match self {
                    $(Self::$term(_) => $term::PAID,)*
                    Self::Custom(term) => term.function.paid(),
                }
            }

            /// Which drones it is paid to.
            pub fn agents(&self) -> AgentSet {
                match self {
                    $(Self::$term(term) => term.agents(),)*
                    Self::Custom(_) => AgentSet::All,
                }
            }

            /// How far ahead it looks for the nearest obstacle \[s\], if it does.
            pub(crate) fn looks_around_secs(&self) -> Option<f32> {
                match self {
                    $(Self::$term(term) => term.looks_around_secs(),)*
                    Self::Custom(_) => None,
                }
            }

            /// The ways to the goal that it is about, if it is and was checked as part of a task.
            pub fn ways(&self) -> Option<&Ways> {
                match self {
                    $(Self::$term(term) => term.ways(),)*
                    Self::Custom(_) => None,
                }
            }

            /// The same for other ways to the goal, if it is about ways.
            pub(crate) fn along(self, ways: Ways) -> Self {
                match self {
                    $(Self::$term(term) => Self::$term(term.along(ways)),)*
                    Self::Custom(term) => Self::Custom(term),
                }
            }

            /// Whether it looks for the point ahead on its ways.
            pub(crate) fn looks_along_ways(&self) -> bool {
                match self {
                    $(Self::$term(term) => term.looks_along_ways(),)*
                    Self::Custom(_) => false,
                }
            }

            /// How far ahead it looks for whom the drone meets \[s\], if it does.
            pub(crate) fn looks_ahead_secs(&self) -> Option<f64> {
                match self {
                    $(Self::$term(term) => term.looks_ahead_secs(),)*
                    Self::Custom(_) => None,
                }
            }

            pub(crate) fn memory(&self) -> Memory {
                match self {
                    $(Self::$term(term) => term.memory(),)*
                    Self::Custom(term) => term.function.memory(),
                }
            }

            fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
                match self {
                    $(Self::$term(term) => term.check(task, field),)*
                    Self::Custom(_) => Ok(()),
                }
            }

            fn prepared(self, task: &RewardTask) -> Self {
                match self {
                    $(Self::$term(term) => Self::$term(term.prepared(task)),)*
                    Self::Custom(term) => Self::Custom(term),
                }
            }

            #[inline(always)]
            fn evaluate_term<const LANES: usize, R: Real>(
                &self,
                view: &StepView<'_, LANES, R>,
                worth: R,
                memory: &mut [Column<LANES, R>],
                values: &mut Column<LANES, R>,
            ) {
                match self {
                    $(Self::$term(term) => term.evaluate(view, worth, memory, values),)*
                    Self::Custom(term) => term.evaluate(view, worth, memory, values),
                }
            }
        }

        $(impl From<$term> for RewardTerm {
            fn from(term: $term) -> Self {
                Self::$term(term)
            }
        })*

        impl From<Custom> for RewardTerm {
            fn from(term: Custom) -> Self {
                Self::Custom(term)
            }
        }
    };
}
