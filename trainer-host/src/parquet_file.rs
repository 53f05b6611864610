//! A flight's table as a Parquet file, for polars, pandas, `DuckDB` and the like.

use std::sync::Arc;

use kestrel_experiments::recording::Table;
use parquet::basic::{Repetition, Type as PhysicalType};
use parquet::data_type::DoubleType;
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

/// A column of doubles, which may be missing, for each name; not compressed.
///
/// # Errors
/// When the encoder fails.
pub(crate) fn parquet(table: &Table) -> Result<Vec<u8>, ParquetError> {
    let column = |name: &String| {
        let column = Type::primitive_type_builder(name, PhysicalType::DOUBLE);
        column.with_repetition(Repetition::OPTIONAL).build().map(Arc::new)
    };
    let columns = table.names.iter().map(column).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("flight").with_fields(columns).build()?);
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::default())?;
    let mut group = writer.next_row_group()?;
    for index in 0..table.names.len() {
        let Some(mut column) = group.next_column()? else { break };
        let present: Vec<i16> = table.rows.iter().map(|row| i16::from(row[index].is_some())).collect();
        let values: Vec<f64> = table.rows.iter().filter_map(|row| row[index]).collect();
        column.typed::<DoubleType>().write_batch(&values, Some(&present), None)?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}
