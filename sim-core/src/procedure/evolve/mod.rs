//! The procedure `evolve`: search, then finishing, then a report.

pub mod finish;
pub mod report;
