-- Exports are leased as jobs are, so that an export whose server died is made by another one.
alter table exports add column lease_expires_at integer;

create index exports_leases on exports (lease_expires_at) where state = 'running';

-- The same order by a word that both databases know.
drop index jobs_by_finished;
create index jobs_by_finished on jobs (coalesce(finished_at, 0), seq);
