-- A job that starts takes the turn of its owner by the trigger that counts it: one statement less at every start.

drop trigger queue_owners_update;

create trigger queue_owners_update after update of state on jobs
when new.state <> old.state and (new.state in ('queued', 'running') or old.state in ('queued', 'running'))
begin
    update queue_owners set
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running'),
        last_start = iif(
            new.state = 'running', max(last_start + 1, (select max(last_start) from queue_owners)), last_start
        )
    where owner = new.owner;
end;
