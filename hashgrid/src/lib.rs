//! hashgrid
