-- Most threads that may compute the packing, as the request has it, and most that it has work for, by its plan at
-- submission: one for the jobs of earlier versions.
alter table jobs add column threads integer;
alter table jobs add column most_threads integer not null default 1;
