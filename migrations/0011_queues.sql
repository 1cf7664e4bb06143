-- Fair queueing between owners: a worker first chooses the owner whose turn it is, then the job of that owner. What was
-- counted for the whole queue is now counted for each owner.

-- Jobs that wait and run, by owner, and the virtual start time of the owner's job that started last (see turns.rs).
create table queue_owners (
    owner      text    primary key,
    queued     integer not null default 0,
    running    integer not null default 0,
    last_start integer not null default -1
) strict, without rowid;

insert into queue_owners (owner, queued, running)
select owner, sum(state = 'queued'), sum(state = 'running') from jobs group by owner;

create trigger queue_owners_insert after insert on jobs
begin
    insert into queue_owners (owner, queued, running)
    values (new.owner, new.state = 'queued', new.state = 'running')
    on conflict (owner) do update set queued = queued + excluded.queued, running = running + excluded.running;
end;

create trigger queue_owners_update after update of state on jobs
when new.state <> old.state and (new.state in ('queued', 'running') or old.state in ('queued', 'running'))
begin
    update queue_owners set
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running')
    where owner = new.owner;
end;

create trigger queue_owners_delete after delete on jobs when old.state in ('queued', 'running')
begin
    update queue_owners set
        queued = queued - (old.state = 'queued'), running = running - (old.state = 'running')
    where owner = old.owner;
end;

-- The first job of an owner is the first entry of the owner in this index.
drop index jobs_queue;
create index jobs_queue on jobs (owner, priority desc, turn, seq) where state = 'queued';

-- Turns are taken apart for each owner and priority.
create table queue_starts (
    owner    text    not null,
    priority integer not null,
    turn     integer not null,
    primary key (owner, priority)
) strict, without rowid;

insert into queue_starts (owner, priority, turn)
select queue_owners.owner, queue_times.priority, queue_times.turn from queue_owners cross join queue_times;

drop table queue_times;

create table queue_owner_flows (
    owner     text    not null,
    flow      integer not null,
    priority  integer not null,
    last_turn integer not null,
    primary key (owner, flow, priority)
) strict, without rowid;

insert into queue_owner_flows (owner, flow, priority, last_turn)
select queue_owners.owner, 0, queue_flows.priority, queue_flows.last_turn from queue_owners cross join queue_flows
where queue_flows.flow = 0
union all
select studies.owner, queue_flows.flow, queue_flows.priority, queue_flows.last_turn
from queue_flows join studies on studies.seq = queue_flows.flow;

drop trigger queue_flows_end;
drop table queue_flows;

create trigger queue_owner_flows_end after delete on studies
begin
    delete from queue_owner_flows where owner = old.owner and flow = old.seq;
end;
