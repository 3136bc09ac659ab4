/**
 * Writes `src/core/transcoder/`: Basis Universal's transcoder of KTX2 textures as three.js brings it, as an ES module that makes no code
 * out of text. The service's Content-Security-Policy allows no `unsafe-eval`, and two functions of Emscripten's glue want it.
 */

import { copyFileSync, existsSync, readFileSync, writeFileSync } from "node:fs";

const from = new URL("../node_modules/three/examples/jsm/libs/basis/", import.meta.url);
const into = new URL("../src/core/transcoder/", import.meta.url);

const REPLACED = [
  [
    "newFunc(Function,args)(...closureArgs)",
    `(function(...given){
if(given.length!==argCount-2)throwBindingError("function "+humanName+" called with "+given.length+" arguments");
const stack=needsDestructorStack?[]:null,first=isClassMethodFunc?1:2,wired=[];
if(isClassMethodFunc)wired.push(argTypes[1].toWireType(stack,this));
for(let i=0;i<argCount-2;++i)wired.push(argTypes[i+2].toWireType(stack,given[i]));
const rv=cppInvokerFunc(cppTargetFunc,...wired);
if(stack!==null)runDestructors(stack);
else for(let i=first;i<argTypes.length;++i)
if(argTypes[i].destructorFunction!==null)argTypes[i].destructorFunction(wired[i-first]);
if(returns)return argTypes[0].fromWireType(rv)})`,
  ],
  [
    "newFunc(Function,params)(...args)",
    `(function(obj,func,destructorsRef,place){
const given=[];let offset=0;
for(const type of types){given.push(type.readValueFromPointer(place+offset));offset+=type.argPackAdvance}
const rv=kind===1?Reflect.construct(func,given):func.call(obj,...given);
if(!retType.isVoid)return emval_returnValue(retType,destructorsRef,rv)})`,
  ],
  [/if \(typeof exports === 'object'[\s\S]*$/, "export default BASIS;\n"],
  [/ENVIRONMENT_IS_NODE=typeof process==[^;]*?(?=;)/, "ENVIRONMENT_IS_NODE=false"],
];

/** Where it is there already nothing is done. */
export function prepareTranscoder() {
  const script = new URL("basis_transcoder.js", into);
  const wasm = new URL("basis_transcoder.wasm", into);
  if (existsSync(script) && existsSync(wasm)) return;
  let text = readFileSync(new URL("basis_transcoder.js", from), "utf8");
  for (const [before, after] of REPLACED) {
    const parts = text.split(before);
    if (parts.length !== 2) throw new Error(`three's transcoder has ${parts.length - 1} times ${before}, expected one`);
    text = parts.join(after);
  }
  writeFileSync(script, text);
  copyFileSync(new URL("basis_transcoder.wasm", from), wasm);
}
