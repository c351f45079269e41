//! neus-render
