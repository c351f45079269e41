//! io-colmap
