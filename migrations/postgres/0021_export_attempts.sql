-- The last attempt of an export that a stop of the server may end: one that does not count raises it, so that no two
-- runs have the same number.
alter table exports add column max_attempts bigint not null default 3;
-- The attempts of exports that were requeued because their file was damaged count anew.
update exports set max_attempts = attempt + 2 where attempt > 1;
