//! What a study found.
