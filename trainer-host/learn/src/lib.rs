//! Reinforcement learning for any environment: neural networks, PPO, and regularisers of continual learning.
//!
//! Read in the order of the data: an [`environment`] and the policy of the [`actor_critic`] make a [`rollout`], that gets
//! [`advantage`]s, the update of [`ppo`] learns from both by [`adam`], and a [`regulariser`] keeps what earlier tasks have
//! taught. Where an environment has derivatives, [`analytic`] learns from them instead. A policy that
//! remembers has a [`gru`] in front. The crate names no drone: [`pendulum`] is the environment that ships with it.
//!
//! ```
//! use kestrel_core::seed::Seed;
//! use kestrel_learn::pendulum::{Pendulum, SwingUp};
//! use kestrel_learn::ppo::{PpoSettings, Trainer};
//!
//! let settings = PpoSettings { environments: 256, discount: 0.9, ..PpoSettings::default() };
//! let mut trainer = Trainer::<Pendulum>::new(&[SwingUp], &settings, Seed(0));
//! let metrics = trainer.update();
//! assert_eq!(metrics.steps, 256 * 32);
//! println!("entropy of the policy: {:.2} nat", metrics.entropy);
//! ```

pub mod actor_critic;
pub mod adam;
pub mod advantage;
pub mod analytic;
pub mod encoder;
pub mod environment;
pub mod gaussian;
pub mod gru;
pub mod network;
pub mod pendulum;
pub mod ppo;
mod quantisation;
pub mod ranks;
pub mod regulariser;
pub mod rollout;
pub mod schedule;
