//! placeholder
use crate::error::Error;
use crate::library::{Data, Model};
/// x
pub struct Curvature;
impl Curvature {
    /// x
    pub fn new(_: &Model) -> Result<Self, Error> {
        Ok(Self)
    }
    /// x
    pub fn write(&mut self, _: &mut Data, _: &mut [f64]) -> Result<(), Error> {
        Ok(())
    }
}
