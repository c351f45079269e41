//! sos-eval
