import sys
import tests.virtual.test_dense as T
bad=0;rx=0;dr=0
for seed in range(int(sys.argv[1]),int(sys.argv[2])):
    v=T.tell(seed)
    rx+=v.received()
    clean=not v.restarts and not v.water.scenario.faults.corrupt
    if v.wrong or (clean and v.dropped("dense")): print(seed,"wrong",len(v.wrong),"dropped",v.dropped("dense"),v.water.scenario.faults.duplicate,v.water.scenario.faults.jitter_s,v.restarts,v.received(),flush=True)
print("done",sys.argv[1:],rx)
