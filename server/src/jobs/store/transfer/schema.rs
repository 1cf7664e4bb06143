//! The tables as PostgreSQL's catalogue describes them.

use std::collections::{BTreeMap, BTreeSet};

use super::TransferError;
use crate::jobs::store::db::{Row, Transaction, Value, query};

/// Columns in their order, without those that the database computes.
const COLUMNS: &str = "
    select c.table_name::text, c.column_name::text, c.data_type::text
    from information_schema.columns c join information_schema.tables t using (table_schema, table_name)
    where table_schema = current_schema() and t.table_type = 'BASE TABLE' and c.is_generated = 'NEVER'
    order by c.table_name, c.ordinal_position";
/// Columns of the primary keys in their order.
const KEYS: &str = "
    select c.relname::text, a.attname::text
    from pg_index i join pg_class c on c.oid = i.indrelid
        cross join lateral unnest(i.indkey::smallint[]) with ordinality as k (attnum, place)
        join pg_attribute a on a.attrelid = i.indrelid and a.attnum = k.attnum
    where i.indisprimary and c.relnamespace = current_schema()::regnamespace
    order by c.relname, k.place";
/// Tables and those that they refer to.
const REFERENCES: &str = "
    select distinct c.relname::text, r.relname::text
    from pg_constraint f join pg_class c on c.oid = f.conrelid join pg_class r on r.oid = f.confrelid
    where f.contype = 'f' and f.connamespace = current_schema()::regnamespace";
/// Columns whose values come from a sequence.
const NUMBERED: &str = "
    select table_name::text, column_name::text from information_schema.columns
    where table_schema = current_schema() and is_identity = 'YES'";
/// The columns of SQLite, without those that it computes.
const COLUMNS_OF_SQLITE: &str = "
    select m.name, x.name from sqlite_schema m join pragma_table_xinfo(m.name) x
    where m.type = 'table' and x.hidden = 0 and m.name not like 'sqlite\\_%' escape '\\'";

/// A table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Table {
    /// Its name.
    pub(super) name: String,
    /// Its columns in the order of PostgreSQL.
    pub(super) columns: Vec<Column>,
    /// The places of the columns of the primary key, in the order of the key.
    pub(super) key: Vec<usize>,
    /// The column whose values the database numbers.
    pub(super) numbered: Option<String>,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    /// Its name.
    pub(super) name: String,
    /// Its type.
    pub(super) kind: Kind,
}

/// The types that the tables have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Integer,
    Real,
    Flag,
    Text,
}

impl Kind {
    fn of(data_type: &str) -> Option<Self> {
        match data_type {
            "bigint" => Some(Self::Integer),
            "double precision" => Some(Self::Real),
            "boolean" => Some(Self::Flag),
            "text" => Some(Self::Text),
            _ => None,
        }
    }

    /// The value of this type in a row.
    ///
    /// # Errors
    /// There is no such column, or it has another type.
    pub(super) fn value(self, row: &Row, place: usize) -> Result<Value, sqlx::Error> {
        Ok(match self {
            Self::Integer => Value::Integer(row.try_get(place)?),
            Self::Real => Value::Real(row.try_get(place)?),
            Self::Flag => Value::Flag(row.try_get(place)?),
            Self::Text => Value::Text(row.try_get(place)?),
        })
    }
}

impl Table {
    /// A name as both databases quote it.
    pub(super) fn quoted(&self) -> String {
        quoted(&self.name)
    }

    /// All columns, or all of the key, separated by commas.
    pub(super) fn list<'c>(columns: impl IntoIterator<Item = &'c Column>) -> String {
        columns.into_iter().map(|column| quoted(&column.name)).collect::<Vec<_>>().join(", ")
    }

    /// The columns of the primary key.
    pub(super) fn key_columns(&self) -> impl Iterator<Item = &Column> {
        self.key.iter().map(|place| &self.columns[*place])
    }
}

/// A name as both databases quote it.
pub(super) fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// All tables, each after those that it refers to. Both databases must have the same ones.
///
/// # Errors
/// The databases', or their tables differ.
pub(super) async fn read(
    postgres: &mut Transaction<'_>,
    sqlite: &mut Transaction<'_>,
) -> Result<Vec<Table>, TransferError> {
    let mut tables: BTreeMap<String, Table> = BTreeMap::new();
    for row in query(COLUMNS).fetch_all(&mut *postgres).await? {
        let (table, name, data_type) = (row.text(0)?, row.text(1)?.to_owned(), row.text(2)?);
        let kind = Kind::of(data_type).ok_or_else(|| {
            TransferError::Schema(format!("the column {table}.{name} has the type {data_type}"))
        })?;
        let new = || Table { name: table.to_owned(), columns: Vec::new(), key: Vec::new(), numbered: None };
        tables.entry(table.to_owned()).or_insert_with(new).columns.push(Column { name, kind });
    }
    for row in query(KEYS).fetch_all(&mut *postgres).await? {
        if let Some(table) = tables.get_mut(row.text(0)?) {
            let name = row.text(1)?;
            table.key.extend(table.columns.iter().position(|column| column.name == name));
        }
    }
    for row in query(NUMBERED).fetch_all(&mut *postgres).await? {
        if let Some(table) = tables.get_mut(row.text(0)?) {
            table.numbered = Some(row.text(1)?.to_owned());
        }
    }
    if let Some(table) = tables.values().find(|table| table.key.is_empty()) {
        return Err(TransferError::Schema(format!("the table {} has no primary key", table.name)));
    }
    let references = pairs(&query(REFERENCES).fetch_all(&mut *postgres).await?)?;
    let found = pairs(&query(COLUMNS_OF_SQLITE).fetch_all(sqlite).await?)?;
    let expected = tables
        .values()
        .flat_map(|table| table.columns.iter().map(|column| (table.name.clone(), column.name.clone())));
    if let Some((table, column)) = found.symmetric_difference(&expected.collect()).next() {
        return Err(TransferError::Schema(format!("only one has the column {table}.{column}")));
    }
    ordered(tables, &references)
}

fn pairs(rows: &[Row]) -> Result<BTreeSet<(String, String)>, sqlx::Error> {
    rows.iter().map(|row| Ok((row.try_get(0)?, row.try_get(1)?))).collect()
}

/// Each table after those that it refers to.
fn ordered(
    mut tables: BTreeMap<String, Table>,
    references: &BTreeSet<(String, String)>,
) -> Result<Vec<Table>, TransferError> {
    let mut ordered: Vec<Table> = Vec::new();
    while !tables.is_empty() {
        let waits = |name: &str| {
            references.iter().any(|(table, to)| table == name && to != name && tables.contains_key(to))
        };
        let ready: Vec<String> = tables.keys().filter(|name| !waits(name)).cloned().collect();
        if ready.is_empty() {
            let names = tables.into_keys().collect::<Vec<_>>().join(", ");
            return Err(TransferError::Schema(format!("the tables {names} refer to each other")));
        }
        ordered.extend(ready.iter().filter_map(|name| tables.remove(name)));
    }
    Ok(ordered)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn tables_come_after_those_that_they_refer_to() {
        let table = |name: &str| {
            let table = Table { name: name.into(), columns: Vec::new(), key: Vec::new(), numbered: None };
            (name.to_owned(), table)
        };
        let references = |pairs: &[(&str, &str)]| {
            pairs.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())).collect()
        };
        let tables = BTreeMap::from(["a", "b", "c", "d"].map(table));
        let found = ordered(tables.clone(), &references(&[("a", "c"), ("c", "d"), ("b", "b")])).unwrap();
        assert_eq!(found.iter().map(|table| table.name.as_str()).collect::<Vec<_>>(), ["b", "d", "c", "a"]);
        let circle = ordered(tables, &references(&[("a", "c"), ("c", "a")]));
        assert!(matches!(circle, Err(TransferError::Schema(names)) if names.contains("a, c")));
    }
}
