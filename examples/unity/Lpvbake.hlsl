// Light of a volume of `lpvbake ... --target unity`, which LpvbakeVolume.Apply gives to all shaders:
// what lpvbake.hlsl makes of its coefficients read trilinearly, over pi, by the factors of ShadeSH9
// (UnityCG.cginc). The files hold what is right when read in this way (--fit).
#ifndef LPVBAKE_HLSL
#define LPVBAKE_HLSL

#ifndef LPVBAKE_DECLARED
Texture3D _LpvbakeR, _LpvbakeG, _LpvbakeB, _LpvbakeR2, _LpvbakeG2, _LpvbakeB2, _LpvbakeX2Y2;
SamplerState lpvbake_linear_clamp_sampler; // Unity makes it what its name says
float4 _LpvbakeScale;  // metres to coordinates of textures; w: order
float4 _LpvbakeOffset; // added to these; w: intensity
#endif

// Irradiance over pi of a plane at a point (metres, world space) with the unit normal n: the
// luminance of a white Lambert surface. To be multiplied by the surface's colour.
float3 LpvbakeIrradianceOverPi(float3 position, float3 n)
{
    float3 uvw = position * _LpvbakeScale.xyz + _LpvbakeOffset.xyz;
#define LPVBAKE_SAMPLE(t) t.SampleLevel(lpvbake_linear_clamp_sampler, uvw, 0.0)
    float4 first = float4(n, 1.0);
    float3 e = float3(dot(LPVBAKE_SAMPLE(_LpvbakeR), first), dot(LPVBAKE_SAMPLE(_LpvbakeG), first),
                      dot(LPVBAKE_SAMPLE(_LpvbakeB), first));
    if (_LpvbakeScale.w > 1.5)
    {
        float4 second = n.xyzz * n.yzzx;
        e += float3(dot(LPVBAKE_SAMPLE(_LpvbakeR2), second), dot(LPVBAKE_SAMPLE(_LpvbakeG2), second),
                    dot(LPVBAKE_SAMPLE(_LpvbakeB2), second));
        e += LPVBAKE_SAMPLE(_LpvbakeX2Y2).rgb * (n.x * n.x - n.y * n.y);
    }
#undef LPVBAKE_SAMPLE
    return max(e, 0.0) * _LpvbakeOffset.w;
}

// For a Custom Function node of Shader Graph.
void Lpvbake_float(float3 Position, float3 Normal, out float3 Light)
{
    Light = LpvbakeIrradianceOverPi(Position, Normal);
}

#endif
