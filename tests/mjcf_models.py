"""Small MJCF models that use every construct whose meaning is not where it stands."""

BULK = '<inertial pos="0.1 0.02 -0.03" quat="0.9 0.1 -0.2 0.3" mass="1.5" diaginertia="0.01 0.02 0.025"/>'
ROD = '<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>'

DEFAULTS = f"""<mujoco>
  <default>
    <geom type="capsule" size="0.02" mass="0.3" contype="0" conaffinity="0"/> <joint axis="0 1 0" range="-70 80"/>
    <site pos="0.1 0 0.05" quat="0.5 0.5 0.5 0.5"/> <equality active="false"/>
    <default class="heavy"> <geom mass="2"/> <joint axis="0 0.6 0.8" pos="0.01 0.02 0"/> </default>
    <default class="slide"> <joint type="slide" axis="1 0 0" range="-0.2 0.3"/> <geom density="3000" mass="0"/>
      </default>
  </default>
  <worldbody>
    <body name="l1" pos="0 0 0.1"> <joint name="a"/> <geom fromto="0 0 0 0.3 0 0"/> <site name="s1"/>
      <body name="l2" pos="0.3 0 0" childclass="heavy"> <joint name="b"/> <geom fromto="0 0 0 0.2 0.1 0"/>
        <geom type="sphere" size="0.05" pos="0.3 0 0" class="main"/> <site name="s2"/>
        <body name="l3" pos="0 0 0.1"> <joint name="c" class="slide"/> <geom fromto="0 0 0 0.2 0 0"/> {BULK} </body>
  </body> </body> </worldbody>
  <equality> <joint joint1="b" joint2="a"/> <joint joint1="c" joint2="a" polycoef="0.1 -2 0 0 0" active="true"/>
    </equality>
</mujoco>"""

FRAMES = f"""<mujoco> <compiler eulerseq="ZYx"/>
  <worldbody> <frame pos="1 2 3" axisangle="1 2 2 40">
    <body name="l1" euler="10 20 30"> <joint name="a" axis="1 1 0" pos="0.1 0 0.2"/> {BULK}
      <site name="s1" xyaxes="0 1 0 -1 0 1"/>
      <frame euler="90 0 0"> <body name="l2" zaxis="1 1 1" pos="0 0.2 0"> <joint name="b" axis="0 0 1"/>
        <inertial pos="0 0 0.1" mass="2" fullinertia="0.02 0.02 0.03 0.001 -0.002 0.003"/>
        <site name="s2" fromto="0 0 0 0.1 0.2 0.3" type="capsule" size="0.01"/>
        <body name="fixed" axisangle="0 0 3 90" pos="0.1 0 0"> <geom type="box" size="0.1 0.05 0.02" euler="0 90 0"/>
          <site name="s3" pos="0.1 0.2 0.3" axisangle="0 1 0 30"/> </body> </body> </frame>
    </body> </frame> </worldbody> </mujoco>"""

RADIANS = f"""<mujoco>
  <compiler autolimits="false"/> <compiler angle="radian"/> <option timestep="0.001"/> <option gravity="0.5 -1 -3.7"/>
  <worldbody>
    <body name="l1" euler="0.3 0.2 0.1"> <joint name="a" axis="0 1 0" range="-1.5 1.5" limited="true"/> {BULK}
      <body name="l2" pos="0.3 0 0"> <joint name="b" axis="0 1 0" range="-1 1" limited="false"/> {BULK}
        <body name="l3" pos="0.3 0 0"> <joint name="c" type="slide" range="0.1 0.2" limited="false"/> {BULK} </body>
  </body> </body> </worldbody> <worldbody>
    <body name="other" pos="0 1 0"> <joint name="d" axis="1 0 0" range="-0.5 0.25" limited="true"/> {ROD} </body>
    <geom type="box" size="100 100 1"/> <body name="ground"> <geom type="box" size="100 100 1"/> </body>
  </worldbody> </mujoco>"""

MASSES = f"""<mujoco> <compiler settotalmass="5" boundmass="0.2" boundinertia="0.003" balanceinertia="true"/>
  <option> <flag gravity="disable"/> </option>
  <worldbody> <geom type="plane" size="5 5 0.1"/>
    <body name="l1"> <joint name="a" axis="0 1 0"/> {ROD}
      <body name="l2" pos="0.3 0 0"> <joint name="b" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="0.8" diaginertia="0.01 0.02 0.05"/>
        <body name="light" pos="0.1 0 0"> <joint name="c" axis="1 0 0"/> <geom size="0.01" mass="0.001"/> </body>
  </body> </body> </worldbody> </mujoco>"""

GEOMS = f"""<mujoco> <compiler inertiafromgeom="true" inertiagrouprange="1 2"/> <option gravity="0 -9.81 0"/>
  <worldbody>
    <body name="l1">
      <joint name="a" axis="0 1 0"/> {BULK} <geom type="box" size="0.1 0.2 0.3" group="1" euler="10 0 0"/>
      <geom type="sphere" size="0.5" group="3"/>
      <body name="l2" pos="0.3 0 0"> <joint name="b" axis="0 1 0"/>
        <geom type="ellipsoid" size="0.1 0.2 0.3" group="2" pos="0.1 0 0" shellinertia="true"/>
        <geom type="cylinder" fromto="0 0 0 0.1 0.1 0.1" size="0.05" group="1" contype="0" conaffinity="0"/>
  </body> </body> </worldbody> </mujoco>"""

SEVERAL_JOINTS = f"""<mujoco>
  <worldbody>
    <body name="l1" pos="0.1 0.2 0.3" euler="20 30 40">
      <joint name="x" type="slide" axis="1 0 0.5" ref="0.3" range="-1 2"/>
      <joint name="y" type="slide" axis="0 1 0" pos="1 1 1"/> <joint name="t" axis="0 1 1" pos="0.1 0 0.2" ref="40"/>
      {BULK} <site name="s1" pos="0.1 0 0"/>
      <body name="l2" pos="0.3 0 0"> <joint name="u" axis="1 0 0" ref="-20" range="-50 60"/>
        <joint name="w" axis="0 0 1"/> {BULK}
        <site name="s2" pos="0 0.1 0"/> </body>
  </body> </worldbody>
  <equality> <joint joint1="u" joint2="t" polycoef="0.2 -1.5 0 0 0"/> <joint joint1="y" polycoef="0.05 0 0 0 0"/>
    </equality>
</mujoco>"""

ARMS = f"""
    <body name="crank"> <joint name="a" axis="0 1 0"/> {BULK} <site name="inner" pos="0.1 0 0"/>
      <body name="coupler" pos="0.2 0 0" euler="0 -30 0"> <joint name="b" axis="0 1 0"/> {BULK}
        <site name="tip" pos="0.2 0 0.1" euler="10 20 30"/>
        <body name="ear" pos="0.2 0 0" euler="0 40 10"> <geom size="0.02"/> <site name="eye" pos="0 0 0.1"/> </body>
    </body> </body>
    <body name="rocker" pos="0.5 0 0.1" euler="0 20 0"> <joint name="c" axis="0 1 0"/> {BULK}
      <site name="end" pos="0.1 0 0" euler="0 0 90"/> </body>"""

CONNECTS = f"""<mujoco> <default> <equality solref="0.01 1"/> </default>
  <worldbody> {ARMS} <site name="wall" pos="0.3 0 0.2"/> </worldbody>
  <equality> <connect body1="ear" body2="rocker" anchor="0.1 0 0.02"/>
    <connect name="pin" body1="crank" anchor="0.1 0.2 0.3"/>
    <connect site1="tip" site2="end"/> <connect name="off" site1="tip" site2="wall" active="false"/>
    <connect name="wall" site1="wall" site2="inner"/> </equality> </mujoco>"""

WELDS = f"""<mujoco>
  <worldbody> {ARMS} </worldbody>
  <equality> <weld body1="coupler" body2="rocker" anchor="0.1 0 0.05" relpose="0.3 0 0.1 0.8 0.2 -0.4 0.4"/>
    <weld name="plain" body1="ear" body2="rocker"/> <weld body1="crank" anchor="0.1 0 0.2" torquescale="2"/>
    <weld name="sites" site1="eye" site2="end"/> <weld name="ball" body1="ear" body2="rocker" torquescale="0"/>
  </equality> </mujoco>"""

DRIVEN = f"""<mujoco> <option density="0"> <flag spring="disable" limit="disable"/> </option>
  <worldbody>
    <body name="l1">
      <joint name="a" axis="0 1 0" armature="0.2" damping="0.1" frictionloss="0.3" range="-10 10"/> {BULK}
      <body name="l2" pos="0.3 0 0" gravcomp="0"> <joint name="b" axis="0 1 0" stiffness="3" springref="20"
        actuatorfrcrange="-4 4"/> {BULK} <site name="s"/> </body> </body>
    <body name="target" mocap="true" pos="1 0 0"> <geom size="0.1" contype="0" conaffinity="0"/> </body> </worldbody>
  <tendon> <fixed name="f"> <joint joint="a" coef="1"/> <joint joint="b" coef="-1"/> </fixed> </tendon>
  <actuator> <position name="m2" joint="b" kp="10"/> <velocity joint="b" kv="2"/>
    <motor joint="a" armature="0.1" gear="3"/>
  </actuator> <sensor> <tendonpos tendon="f"/> </sensor> <keyframe> <key qpos="0.3 -0.2"/> <key/> </keyframe>
    </mujoco>"""

COPIES = f"""<mujoco> <compiler fusestatic="true"/>
  <asset> <mesh name="wedge" vertex="0 0 0 0.1 0 0 0 0.2 0 0 0 0.3" scale="1 2 1"/>
    <hfield name="hills" nrow="2" ncol="2" size="1 1 1 1"/>
      <texture name="sky" type="skybox" builtin="flat" width="8" height="8"/>
  </asset>
  <worldbody> <geom type="hfield" hfield="hills"/> <light pos="0 0 3"/> <camera name="eye"/>
    <body name="stand" pos="0 0 1"> <geom size="0.1"/>
      <replicate count="3" offset="0 0.2 0" euler="0 0 30">
        <body name="arm" pos="0.1 0 0"> <joint name="j" axis="0 1 0"/> {ROD} <site name="s" pos="0.3 0 0"/>
          <body name="hand" pos="0.3 0 0"> <joint name="k" axis="0 0 1"/>
            <geom type="mesh" mesh="wedge" density="500"/> </body>
      </body> </replicate>
  </body> </worldbody> <contact> <exclude body1="arm0" body2="hand0"/> </contact> </mujoco>"""

MODELS = {
    "defaults": DEFAULTS,
    "frames": FRAMES,
    "repeated sections in radians": RADIANS,
    "settotalmass, bounds and balance": MASSES,
    "inertia from geoms": GEOMS,
    "several joints with ref": SEVERAL_JOINTS,
    "connects": CONNECTS,
    "welds": WELDS,
    "drives": DRIVEN,
    "copies and meshes": COPIES,
}

UNMODELLED = f"""<mujoco> <option density="1.2" viscosity="1e-5"/>
  <extension> <plugin plugin="mujoco.elasticity.cable"/> </extension>
  <worldbody> <site name="o"/> <body name="led" mocap="true"/>
    <body name="base" gravcomp="0.5"> <freejoint name="root"/> {BULK}
      <body> <joint name="shoulder" type="ball"/> {BULK}
        <body name="arm"> <joint name="elbow" stiffness="3"/> {BULK} <site name="p"/>
          <joint name="bent" stiffness="0 1 0" axis="0 1 0" actuatorfrcrange="-3 4"/> </body> </body> </body>
    <body name="cable"> <plugin plugin="mujoco.elasticity.cable"> <config key="twist" value="1"/> </plugin>
      <geom size="0.1"/> </body>
    <body name="bed" pos="0 0 2"> <flexcomp name="sheet" type="grid" count="2 2 1" spacing="1 1 1" dim="2"/> </body>
  </worldbody>
  <tendon>
    <spatial name="rope" stiffness="1" damping="2" range="0 1"> <site site="o"/> <site site="p"/> </spatial>
    <fixed name="strap" frictionloss="1" armature="1"> <joint joint="elbow" coef="1"/> </fixed> </tendon>
  <equality> <tendon name="taut" tendon1="rope"/> <weld name="grip" body1="led" body2="arm"/>
    <joint name="cam" joint1="elbow" joint2="bent" polycoef="0 1 0.5 0 0"/>
    <tendon name="gone" tendon1="rope" active="false"/> </equality>
  <actuator> <motor name="pull" tendon="rope"/> <motor name="jet" site="p" refsite="o"/> <motor joint="elbow"/>
  </actuator> </mujoco>"""
