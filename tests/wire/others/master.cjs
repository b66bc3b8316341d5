/* node master.cjs PORT PLACES: the master of vda-5050-lib drives robot_0 from a over b to c, where it picks, and robot_1 from e to d. */
const { MasterController, BlockingType } = require("vda-5050-lib");
const port = process.argv[2];
const xy = JSON.parse(process.argv[3]);
const order = (id, names, action) => ({
  orderId: id, orderUpdateId: 0,
  nodes: names.map((n, k) => ({ nodeId: n, sequenceId: 2 * k, released: true, nodePosition: { x: xy[n][0], y: xy[n][1], mapId: "L1" },
    actions: k == names.length - 1 && action ? [{ actionType: "pick", actionId: id + "-pick", blockingType: BlockingType.Hard,
      actionParameters: [{ key: "stationType", value: "floor" }, { key: "loadType", value: "EPAL" }, { key: "duration", value: 2 }] }] : [] })),
  edges: names.slice(1).map((n, k) => ({ edgeId: names[k] + n, sequenceId: 2 * k + 1, released: true, startNodeId: names[k], endNodeId: n, actions: [] })),
});
(async () => {
  const m = new MasterController({ interfaceName: "uagv", transport: { brokerUrl: `mqtt://127.0.0.1:${port}` }, vdaVersion: "2.0.0" }, {});
  await m.start();
  const done = [];
  const go = (serial, o) => m.assignOrder({ manufacturer: "mrp_sumo", serialNumber: serial }, o, {
    onOrderProcessed: (error, cancelled, active, ctx) => { console.log("processed", serial, error ? JSON.stringify(error).slice(0, 300) : "ok", cancelled, active); done.push(serial); if (done.length == 2) process.exit(0); },
    onNodeTraversed: (node) => console.log("node", serial, node.nodeId),
    onActionStateChanged: (s) => console.log("action", serial, s.actionStatus),
  });
  console.log(await go("robot_0", order("o1", ["a", "b", "c"], true)) !== undefined);
  await go("robot_1", order("o2", ["e", "d"], false));
})().catch(e => { console.log("failed", e); process.exit(1); });
