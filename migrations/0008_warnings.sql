-- What the plan of a job's request warns of, as a JSON list of sentences. A finished job shows the warnings of its
-- result instead.
alter table jobs add column warnings text not null default '[]';
